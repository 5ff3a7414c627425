"""Talks MAVLink services with pymavlink, an independent client: signing and file transfer.

usage: pymavlink_services.py signing ENDPOINT KEY
       pymavlink_services.py ftp ENDPOINT FOLDER

ENDPOINT is pymavlink's, such as udpin:127.0.0.1:14550; KEY are 64 hexadecimal digits. `signing` sends a heartbeat with the
right key, again the same bytes, one with another key and one without, and expects a signed heartbeat back. `ftp` lists the
folder "files" of component 1/191, fetches its "large" into FOLDER and asks for its checksum.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import os
import sys
import zlib

os.environ["MAVLINK20"] = "1"  # read when pymavlink is loaded

from pymavlink import mavftp, mavutil
from pymavlink.dialects.v20 import common

PATIENCE_S = 20.0


class Failure(Exception):
    """What did not work."""


def connect(endpoint):
    return mavutil.mavlink_connection(endpoint, source_system=255, source_component=190)


def heard(link, what):
    """The next heartbeat of the companion, its signature checked by pymavlink."""
    message = link.recv_match(type="HEARTBEAT", blocking=True, timeout=PATIENCE_S)
    if message is None:
        raise Failure(f"no heartbeat {what} within {PATIENCE_S:.0f} s")
    return message


def beat(link):
    link.mav.heartbeat_send(common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE)


def signing(endpoint, key):
    link = connect(endpoint)
    link.setup_signing(bytes.fromhex(key), link_id=5)
    if not heard(link, "with a right signature").get_signed():
        raise Failure("the heartbeat is not signed")
    sent = []
    write, link.write = link.write, lambda data: (sent.append(bytes(data)), write(data))
    beat(link)
    write(sent[0])  # a recording
    link.mav.signing.secret_key = bytes(32)
    beat(link)
    link.disable_signing()
    beat(link)
    # Two more from the other end: meanwhile it has read all of it.
    link.setup_signing(bytes.fromhex(key), link_id=5)
    while link.recv_match(blocking=False):
        pass
    heard(link, "after the others")
    heard(link, "after the others")
    print("signed both ways")


def ftp(endpoint, folder):
    link = connect(endpoint)
    heard(link, "from the companion")
    beat(link)
    client = mavftp.MAVFTP(link, target_system=1, target_component=191)

    def expect_success(what, result):
        if result.error_code != mavftp.FtpError.Success:
            raise Failure(f"{what}: {result.error_code!r}")

    expect_success("list", client.cmd_list(["files"]))
    names = sorted((entry.name, entry.size_b) for entry in client.list_result if not entry.is_dir)
    print("listed", names)
    fetched = os.path.join(folder, "by_pymavlink")
    client.cmd_get(["files/large", fetched])
    expect_success("get", client.process_ftp_reply("OpenFileRO", timeout=PATIENCE_S))
    with open(fetched, "rb") as file:
        print("fetched", zlib.crc32(file.read()))
    client.cmd_get(["../outside", os.path.join(folder, "stolen")])
    result = client.process_ftp_reply("OpenFileRO", timeout=PATIENCE_S)
    if result.error_code == mavftp.FtpError.Success:
        raise Failure("a file outside of the folder was served")
    print("refused", result.error_code.name)


def main():
    services = {"signing": signing, "ftp": ftp}
    if len(sys.argv) != 4 or sys.argv[1] not in services:
        sys.exit(__doc__)
    try:
        services[sys.argv[1]](sys.argv[2], sys.argv[3])
    except Failure as failure:
        sys.exit(f"pymavlink_services: {failure}")


if __name__ == "__main__":
    main()
