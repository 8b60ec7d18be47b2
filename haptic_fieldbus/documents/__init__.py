"""TOML files, read into frozen dataclasses; all faults of a file at once.

Each fault has its key and its line. Three modules contribute to it: `document` has the content of the file, `expected`
the schema in plain words, and `positions` the lines. Pydantic is imported when a file is validated, the parser with
positions only when there is a fault.
"""

from haptic_fieldbus.documents.document import Document, check_kind, knows, read_document, schema_of, table_of
from haptic_fieldbus.documents.expected import KeyPath
from haptic_fieldbus.documents.names import beside, file_names, file_of, is_eds, is_path, nearest, suggestion
from haptic_fieldbus.documents.safe_read import EDS_SIZE, TABLE_SIZE, TOML_SIZE, read_octets

__all__ = [
    "EDS_SIZE", "TABLE_SIZE", "TOML_SIZE", "Document", "KeyPath", "beside", "check_kind", "file_names", "file_of",
    "is_eds", "is_path", "knows", "nearest", "read_document", "read_octets", "schema_of", "suggestion", "table_of",
]  # fmt: skip
