"""Writes and reads the frames of a MAVLink dialect with pymavlink, whose code is generated from the XML on the spot.

usage: dialect_frames.py DIALECT.xml PREFIX FRAMES

PREFIX is how the names of the dialect's own messages begin. FRAMES is a file with one frame a line, in hexadecimal. Prints
one JSON object:
  messages  [{id, name, crc_extra, length}] of the dialect and all that it includes
  read      [{name, fields}] of the frames in the file
  read_newer  the same frames, read by a later version of the dialect: one in which each message has got an extension
  built     [{name, fields, frame}] of frames with many values of the fields, zeros at the end included
  built_newer  the same in that later version
  built_extended  [{name, frame}] of messages from included dialects that have extensions
  refused   [{name, frame}] of frames whose message has another definition
Fields that are not finite are text. Exits 1 with the reason if the generator refuses the XML.
"""

import json
import math
import os
import random
import re
import shutil
import sys
import tempfile
from pathlib import Path

os.environ["MAVLINK20"] = "1"  # read when pymavlink is loaded

from decode_tlog import dialect_module

MAX_PAYLOAD = 255
NEW_FIELD = "added_later"
FLOAT_MAX = 3.4028234663852886e38
RANGES = {
    "uint8_t": (0, 2**8 - 1),
    "int8_t": (-(2**7), 2**7 - 1),
    "uint16_t": (0, 2**16 - 1),
    "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1),
    "int64_t": (-(2**63), 2**63 - 1),
}
SIZES = {"char": 1, "float": 4, "double": 8, **{kind: int(re.sub(r"\D", "", kind)) // 8 for kind in RANGES}}
REALS = [0.5, -1.25, math.nan, math.inf, -math.inf, FLOAT_MAX, 1e-45, -0.0, 1 / 3]
RANDOM_CASES = 20


def newer(xml, folder, messages):
    """The dialect in its later version, beside what it includes."""
    for file in xml.parent.glob("*.xml"):
        shutil.copy(file, folder)
    text = xml.read_text(encoding="utf-8")
    for message in messages:
        field = f'<field type="uint32_t" name="{NEW_FIELD}">Added later.</field>'
        pattern = rf'(<message id="\d+" name="{message.msgname}">.*?)(\s*</message>)'
        text, found = re.subn(pattern, rf"\1<extensions/>{field}\2", text, count=1, flags=re.DOTALL)
        if not found:
            sys.exit(f"dialect_frames: no {message.msgname} in {xml}")
    path = Path(folder) / xml.name
    path.write_text(text, encoding="utf-8")
    return dialect_module(path)


def own(module, prefix):
    return [message for message in module.mavlink_map.values() if message.msgname.startswith(prefix)]


def types(message):
    """Name, type and array length of each field, in the order of the wire; extensions come last."""
    by_name = dict(zip(message.fieldnames, message.fieldtypes))
    for name, length in zip(message.ordered_fieldnames, message.array_lengths):
        yield name, by_name[name], length


def values(message, number):
    """A value for each field: `number(type, i)` says which, i counting all numbers of the message."""
    fields, i = {}, 0
    for name, kind, length in types(message):
        numbers = [number(kind, i + k) for k in range(max(length, 1))]
        i += len(numbers)
        if kind == "char":
            fields[name] = bytes(numbers)
        else:
            fields[name] = numbers if length else numbers[0]
    return fields


def cases(message):
    """Zeros, extremes, numbers by chance, and numbers by chance that end somewhere and are zeros from there on."""
    chance = random.Random(message.msgname)
    count = sum(max(length, 1) for _name, _kind, length in types(message))

    def by_chance(kind):
        if kind == "char":
            return chance.randrange(ord("A"), ord("Z") + 1)
        return chance.choice(REALS) if kind in ("float", "double") else chance.randint(*RANGES[kind])

    def extreme(end):
        return lambda kind, _i: {"char": ord("Z"), "float": FLOAT_MAX, "double": FLOAT_MAX}.get(kind) or RANGES[kind][end]

    yield values(message, lambda _kind, _i: 0)
    yield values(message, extreme(0))
    yield values(message, extreme(1))
    for _ in range(RANDOM_CASES):
        yield values(message, lambda kind, _i: by_chance(kind))
        end = chance.randrange(count)
        yield values(message, lambda kind, i: by_chance(kind) if i < end else 0)


def writable(value):
    """As JSON and as the other side print it."""
    if isinstance(value, (list, tuple)):
        return [writable(each) for each in value]
    if isinstance(value, bytes):
        return value.decode("ascii").rstrip("\0")
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "inf" if value > 0 else "-inf"
    return value


def frame(module, message, fields):
    """The frame that pymavlink makes of it, as 1/191."""
    encoder = module.MAVLink(None, srcSystem=1, srcComponent=191)
    packed = message(*(fields[name] for name in message.fieldnames)).pack(encoder)
    return bytes(packed).hex()


def build(module, messages):
    built = []
    for message in messages:
        for fields in cases(message):
            told = {name: writable(value) for name, value in fields.items() if name != NEW_FIELD}
            built.append({"name": message.msgname, "fields": told, "frame": frame(module, message, fields)})
    return built


def read(module, lines):
    found = []
    for line in lines:
        message = module.MAVLink(None).decode(bytearray.fromhex(line))
        fields = {name: writable(getattr(message, name)) for name in message.get_fieldnames()}
        if fields.pop(NEW_FIELD, 0) != 0:
            sys.exit(f"dialect_frames: {line} has something where it ends")
        found.append({"name": message.get_type(), "fields": fields})
    return found


def extended(module, prefix):
    """One of each message of the included dialects, all numbers 1 but those that must be of an enumeration."""
    built = []
    for message in module.mavlink_map.values():
        if message.msgname.startswith(prefix):
            continue
        fields = values(message, lambda kind, _i: ord("A") if kind == "char" else 1)
        for name, enum in message.fieldenums_by_name.items():
            allowed = [number for number, entry in module.enums[enum].items() if not entry.name.endswith("_ENUM_END")]
            if not isinstance(fields[name], list) and 1 not in allowed:
                fields[name] = min(allowed)
        built.append({"name": message.msgname, "frame": frame(module, message, fields)})
    return built


def refused(module, messages):
    """Frames of a peer whose definition of the message is another: its checksum begins with another seed."""
    frames = []
    for message in messages:
        seed = message.crc_extra
        message.crc_extra = seed ^ 0x55
        fields = values(message, lambda _kind, _i: 1)
        frames.append({"name": message.msgname, "frame": frame(module, message, fields)})
        message.crc_extra = seed
    return frames


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    xml, prefix, file = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    lines = file.read_text(encoding="ascii").split()
    module = dialect_module(xml)
    known = [
        {"id": m.id, "name": m.msgname, "crc_extra": m.crc_extra, "length": m.unpacker.size}
        for m in module.mavlink_map.values()
    ]
    messages = own(module, prefix)
    report = {
        "messages": known,
        "read": read(module, lines),
        "built": build(module, messages),
        "built_extended": extended(module, prefix),
        "refused": refused(module, messages),
    }
    with tempfile.TemporaryDirectory() as folder:
        roomy = [message for message in messages if message.unpacker.size + SIZES["uint32_t"] <= MAX_PAYLOAD]
        later = newer(xml, folder, roomy)
        names = {message.msgname for message in roomy}
        report["built_newer"] = build(later, [message for message in own(later, prefix) if message.msgname in names])
        report["read_newer"] = read(later, lines)
    print(json.dumps(report, allow_nan=False))


if __name__ == "__main__":
    main()
