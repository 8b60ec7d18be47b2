"""The kind of file that a TOML text is: a profile, a rig or a scene given in the place of another is told as such.

Each kind has a table that no other has. Without this a rig that is checked as a profile has a page of faults, and none
of them says the one thing that is wrong.
"""

from haptic_fieldbus.documents.document import Document
from haptic_fieldbus.errors import Fault

KINDS = {
    "drive": ("a drive profile", "give it as --drive FILE, or check it by: haptic-fieldbus profiles check FILE"),
    "bus": ("a rig", "give it as --rig FILE; it is checked by: haptic-fieldbus plan wall --rig FILE"),
    "element": ("a scene", "give it as SCENE, or check it by: haptic-fieldbus scenes check FILE"),
}
"""Table → the kind of a file that has it, and what to do with such a file."""


def check_kind(document: Document, table: str) -> None:
    """Raise the document's error with one fault when it lacks the `table` of its kind, and has that of another."""
    if table in document.data:
        return
    for other, (kind, advice) in KINDS.items():
        if other in document.data:
            message = f"this is {kind}, and not {KINDS[table][0]}; {advice.replace('FILE', document.source)}"
            raise document.error(document.source, [Fault("", message)])
