"""Transfers files with MAVSDK, an independent client: lists, fetches with and without a burst, writes, compares.

usage: mavsdk_ftp.py URI FOLDER

URI is MAVSDK's, such as udpin://127.0.0.1:14550. The server is component 191 of the first system; its folder "files" holds
"large". What is fetched goes into FOLDER.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import os
import sys
import threading

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError
from mavsdk.plugins.ftp import Ftp, FtpResult

PATIENCE_S = 30.0


class Failure(Exception):
    """What did not work."""


def finish(what, start):
    """Runs a transfer to its end."""
    done, results = threading.Event(), []

    def callback(result, _progress, _user_data):
        if result != FtpResult.NEXT:
            results.append(result)
            done.set()

    start(callback)
    if not done.wait(PATIENCE_S):
        raise Failure(f"{what}: no end within {PATIENCE_S:.0f} s")
    if results[0] != FtpResult.SUCCESS:
        raise Failure(f"{what}: {results[0].name}")


def meet(mavsdk, uri, folder):
    if mavsdk.add_any_connection(uri) != ConnectionResult.SUCCESS:
        raise Failure(f"cannot open {uri}")
    system = mavsdk.first_autopilot(PATIENCE_S)
    if system is None:
        raise Failure(f"no autopilot on {uri} within {PATIENCE_S:.0f} s")
    ftp = Ftp(system)
    ftp.set_target_compid(191)
    listing = ftp.list_directory("files")
    print("listed", sorted((entry.name, entry.size_bytes) for entry in listing.entries))
    for use_burst in (True, False):
        fetched = os.path.join(folder, "burst" if use_burst else "plain")
        os.mkdir(fetched)
        finish("download", lambda callback: ftp.download_async("files/large", fetched, use_burst, callback))
        if not ftp.are_files_identical(os.path.join(fetched, "large"), "files/large"):
            raise Failure("the file fetched differs")
    written = os.path.join(folder, "written")
    with open(written, "wb") as file:
        file.write(bytes(range(256)) * 20)
    finish("upload", lambda callback: ftp.upload_async(written, "files", callback))
    print("fetched twice, written once, all equal")
    try:
        ftp.remove_file("../outside")
    except MavsdkError as error:
        print("refused", type(error).__name__)
    else:
        raise Failure("a file outside of the folder was removed")


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        try:
            meet(mavsdk, sys.argv[1], sys.argv[2])
        except (Failure, MavsdkError) as error:
            sys.exit(f"mavsdk_ftp: {error}")


if __name__ == "__main__":
    main()
