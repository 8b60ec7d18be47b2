"""Build the objects of an EDS from its sections; a missing or wrong key becomes a fault and gets the nearest meaning.

Reference: CiA 306-1, object description (ParameterName, ObjectType, DataType, AccessType, LowLimit, HighLimit,
DefaultValue, PDOMapping, SubNumber, CompactSubObj) and, in a DCF, ParameterValue.
"""

from collections.abc import Mapping

from haptic_fieldbus.eds.lines import FileSection, value_of
from haptic_fieldbus.eds.model import ACCESS_TYPES, EdsEntry, EdsObject, EdsValue, ObjectCode
from haptic_fieldbus.eds.names import EdsType
from haptic_fieldbus.errors import Fault

ACCESS_WHEN_MISSING = "ro"
"""Access of an entry that gives none: read-only does no harm."""
HIGHEST_ELEMENT = 0xFE
"""Highest sub-index of an array element (CiA 301, 7.4.3); FFh describes the object itself."""
_TYPES = {type.value: type for type in EdsType}


class ObjectReader:
    """Reads one object and notes its faults; `sections` are all of the file, for compact arrays."""

    def __init__(self, index: int, sections: Mapping[str, FileSection], faults: list[Fault]) -> None:
        self._index = index
        self._sections = sections
        self._faults = faults

    def read(self, head: FileSection | None, members: Mapping[int, FileSection]) -> EdsObject:
        """Return the object from its own section, None if there is none, and the sections of its sub-indices."""
        if head is None:
            first = next(iter(members.values()))
            self._fault(first, "", f"[{self._index:04X}], the object itself, is missing: treated as a record")
            return EdsObject(self._index, "", ObjectCode.RECORD, self._members(members), first.line)
        code = self._code(head)
        compact = self._number(head, "CompactSubObj") or 0
        if not 0 <= compact <= HIGHEST_ELEMENT:
            self._fault(head, "CompactSubObj", f"{compact}, expected 0 to {HIGHEST_ELEMENT}: treated as 0")
            compact = 0
        found = EdsObject(self._index, self._name(head), code, {}, head.line)
        if compact:
            entries = self._compact(head, compact) | self._members(members)
        elif found.is_simple and not members:
            entries = {0: self.entry(head, 0, code)}
        else:
            entries = self._members(members)
            if found.is_simple:
                self._fault(head, "ObjectType", "a variable with sub-indices: treated as a record")
            elif self._number(head, "SubNumber") != len(members):
                said = head.text("SubNumber") or "missing"
                self._fault(head, "SubNumber", f"{said}, but the file has {len(members)} sub-indices")
        return EdsObject(found.index, found.name, found.code, dict(sorted(entries.items())), found.line)

    def entry(self, section: FileSection, subindex: int, code: ObjectCode = ObjectCode.VAR) -> EdsEntry:
        """Return one sub-index from the section that describes it."""
        type = self._type(section, code)
        return EdsEntry(
            index=self._index,
            subindex=subindex,
            name=self._name(section),
            type=type,
            access=self._access(section, type),
            default=self._value(section, "DefaultValue", type),
            parameter=self._value(section, "ParameterValue", type),
            low=self._limit(section, "LowLimit", type),
            high=self._limit(section, "HighLimit", type),
            mappable=bool(self._number(section, "PDOMapping")),
            line=section.line,
        )

    def _members(self, members: Mapping[int, FileSection]) -> dict[int, EdsEntry]:
        return {
            subindex: self.entry(section, subindex, self._code(section))
            for subindex, section in sorted(members.items())
        }

    def _compact(self, head: FileSection, count: int) -> dict[int, EdsEntry]:
        """Return the entries of `CompactSubObj`: `count` equal elements, and sub-index 0 with their number."""
        names = self._sections.get(f"{self._index:04x}name")
        values = self._sections.get(f"{self._index:04x}value")
        # The object's own section describes all of its elements.
        pattern = self.entry(head, 1)
        length = EdsEntry(
            self._index, 0, "Number of entries", EdsType.UNSIGNED8, ACCESS_WHEN_MISSING, default=count, line=head.line
        )
        entries = {0: length}
        for subindex in range(1, count + 1):
            name = names.text(str(subindex)) if names is not None else ""
            value = self._value(values, str(subindex), pattern.type) if values is not None else None
            entries[subindex] = EdsEntry(
                self._index, subindex, name or f"{pattern.name}{subindex}", pattern.type, pattern.access,
                pattern.default, value, pattern.low, pattern.high, pattern.mappable, pattern.line,
            )  # fmt: skip
        return entries

    def _name(self, section: FileSection) -> str:
        name = section.text("ParameterName")
        if not name:
            self._fault(section, "ParameterName", "missing")
        return name

    def _code(self, section: FileSection) -> ObjectCode:
        """Return the object code; a variable when it is missing (CiA 306-1) or unknown."""
        number = self._number(section, "ObjectType")
        if number is None:
            return ObjectCode.VAR
        try:
            return ObjectCode(number)
        except ValueError:
            self._fault(section, "ObjectType", f"{number} is not an object code: treated as a variable")
            return ObjectCode.VAR

    def _type(self, section: FileSection, code: ObjectCode) -> EdsType | None:
        """Return the data type; None when it is missing or not basic. A domain may leave it out."""
        if not section.text("DataType"):
            if code is not ObjectCode.DOMAIN:
                self._fault(section, "DataType", "missing: the length of the value is not known")
                return None
            return EdsType.DOMAIN
        number = self._number(section, "DataType")
        if number is None or number in _TYPES:
            # No type has the index 0, so a number that is not understood gives None; its fault is noted already.
            return _TYPES.get(number or 0)
        self._fault(section, "DataType", f"{number:04X}h is no basic data type: its length is not known")
        return None

    def _access(self, section: FileSection, type: EdsType | None) -> str:
        access = section.text("AccessType").lower()
        if access in ACCESS_TYPES:
            return access
        if type is not EdsType.DOMAIN or access:
            found = f'"{access}"' if access else "missing"
            self._fault(section, "AccessType", f"{found}, expected one of {', '.join(ACCESS_TYPES)}: treated as ro")
        return ACCESS_WHEN_MISSING

    def _limit(self, section: FileSection, key: str, type: EdsType | None) -> int | float | None:
        """Return a limit; None for texts and octets, which have none."""
        value = self._value(section, key, type) if type is None or type.is_integer or type.size else None
        return value if isinstance(value, int | float) else None

    def _value(self, section: FileSection, key: str, type: EdsType | None) -> EdsValue | None:
        """Return a value of the type; None when it is missing, empty or not understood."""
        text = section.text(key)
        if not text:
            return None
        try:
            return value_of(text, type)
        except ValueError as error:
            self._fault(section, key, str(error))
            return None

    def _number(self, section: FileSection, key: str) -> int | None:
        return section.number(key, self._faults)

    def _fault(self, section: FileSection, key: str, message: str) -> None:
        self._faults.append(section.fault(key, message))
