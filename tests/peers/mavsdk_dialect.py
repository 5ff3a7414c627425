"""Reads and writes messages of a private MAVLink dialect with MAVSDK, which learns it from the XML while it runs.

usage: mavsdk_dialect.py echo URI DIALECT.xml PREFIX
       mavsdk_dialect.py listen URI DIALECT.xml PREFIX NAME FIELD MASK [ALSO...]

URI is MAVSDK's, such as udpin://127.0.0.1:14550; PREFIX is how the names of the dialect's messages begin. Both print each
message of the dialect as one JSON object a line, {name, from, fields}. `echo` also sends it back, until the other end says
"all came back". `listen` ends with the first message NAME whose FIELD has all bits of MASK after each message ALSO was heard.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import json
import queue
import sys
import time
from pathlib import Path

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

PATIENCE_S = 30.0


class Failure(Exception):
    """What did not work."""


class Dialect:
    """A system that speaks the dialect, and what it says."""

    def __init__(self, mavsdk, uri, xml, prefix):
        if mavsdk.add_any_connection(uri) != ConnectionResult.SUCCESS:
            raise Failure(f"cannot open {uri}")
        system = mavsdk.first_autopilot(PATIENCE_S)
        if system is None:
            raise Failure(f"no autopilot on {uri} within {PATIENCE_S:.0f} s")
        self.prefix = prefix
        self.direct = MavlinkDirect(system)
        self.direct.load_custom_xml(xml.read_text(encoding="utf-8"))
        self.heard = queue.SimpleQueue()
        self.direct.subscribe_message("", lambda message, _user_data: self.heard.put(message))

    def messages(self):
        """Prints those of the dialect, and yields all."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                message = self.heard.get(timeout=max(deadline - time.monotonic(), 0))
            except queue.Empty:
                raise Failure(f"what is waited for did not come within {PATIENCE_S:.0f} s") from None
            fields = json.loads(message.fields_json)
            about = {key: fields.pop(key, None) for key in ("message_id", "message_name")}
            if about["message_name"] != message.message_name:
                raise Failure(f"{message.message_name} says that it is {about['message_name']}")
            if message.message_name.startswith(self.prefix):
                address = [message.system_id, message.component_id]
                print(json.dumps({"name": message.message_name, "from": address, "fields": fields}))
            yield message, fields

    def send(self, name, fields):
        self.direct.send_message(MavlinkMessage(name, 0, 0, 0, 0, json.dumps(fields)))


def echo(dialect):
    for message, fields in dialect.messages():
        if message.message_name == "STATUSTEXT" and fields["text"].startswith("all came back"):
            return
        if message.message_name.startswith(dialect.prefix):
            dialect.send(message.message_name, fields)


def listen(dialect, name, field, mask, *also):
    missing = set(also)
    for message, fields in dialect.messages():
        missing.discard(message.message_name)
        is_last = message.message_name == name and fields[field] & int(mask) == int(mask)
        if is_last and not missing:
            return


def main():
    uses = {"echo": (echo, [5]), "listen": (listen, range(8, 16))}
    use, counts = uses.get(sys.argv[1] if len(sys.argv) > 1 else "", (None, []))
    if len(sys.argv) not in counts:
        sys.exit(__doc__)
    uri, xml, prefix = sys.argv[2], Path(sys.argv[3]), sys.argv[4]
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        try:
            use(Dialect(mavsdk, uri, xml, prefix), *sys.argv[5:])
        except (Failure, MavsdkError) as error:
            sys.exit(f"mavsdk_dialect: {error}")


if __name__ == "__main__":
    main()
