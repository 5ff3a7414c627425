"""Decodes a Tandem telemetry log with pymavlink, whose parser is generated from our dialect by its own generator.

usage: decode_tlog.py DIALECT.xml FILE.tlog

Prints one JSON object: {"frames": n, "bad": n, "messages": {"HEARTBEAT": n, ...}}. Exits 1 if a frame is bad.
"""

import contextlib
import importlib.util
import json
import os
import struct
import sys
import tempfile
from collections import Counter
from pathlib import Path

os.environ["MAVLINK20"] = "1"
from pymavlink.generator import mavgen  # noqa: E402  (the variable is read at import)


def dialect_module(xml: Path):
    """The Python module that pymavlink generates from `xml`."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "tandem.py"
        options = mavgen.Opts(str(output), wire_protocol="2.0", language="Python3", validate=True)
        with contextlib.redirect_stdout(sys.stderr):
            if not mavgen.mavgen(options, [str(xml)]):
                sys.exit(f"mavgen refuses {xml}")
        spec = importlib.util.spec_from_file_location("tandem", output)
        module = importlib.util.module_from_spec(spec)
        sys.modules["tandem"] = module
        spec.loader.exec_module(module)
        return module


def frames(log: bytes):
    """Each record of the log, 8 bytes of time and one MAVLink 2 frame; None where there is no frame."""
    at = 0
    while at < len(log):
        start = at + 8
        if start + 12 > len(log) or log[start] != 0xFD:
            yield None
            return
        (length, flags) = struct.unpack_from("BB", log, start + 1)
        end = start + 12 + length + (13 if flags & 1 else 0)
        yield log[start:end]
        at = end


def main() -> int:
    xml, tlog = map(Path, sys.argv[1:])
    mavlink = dialect_module(xml)
    counts, bad = Counter(), 0
    for frame in frames(tlog.read_bytes()):
        try:
            message = mavlink.MAVLink(None).decode(bytearray(frame)) if frame else None
        except mavlink.MAVError as error:
            print(error, file=sys.stderr)
            message = None
        if message is None or message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
            bad += 1
        else:
            counts[message.get_type()] += 1
    print(json.dumps({"frames": sum(counts.values()) + bad, "bad": bad, "messages": dict(sorted(counts.items()))}))
    return 1 if bad or not counts else 0


if __name__ == "__main__":
    sys.exit(main())
