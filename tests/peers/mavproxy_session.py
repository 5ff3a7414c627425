"""A session of MAVProxy, an independent ground station: it connects, fetches all parameters, and uploads a mission.

usage: mavproxy_session.py ENDPOINT FOLDER

ENDPOINT is MAVProxy's, such as udpin:127.0.0.1:14550; its logs and files go into FOLDER.
Exits 0 if all of it worked and MAVProxy complained of nothing, 1 with what it said otherwise.
"""

import os
import re
import subprocess
import sys
import threading
import time

PATIENCE_S = 60.0
MISSION = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.3977418\t8.5455938\t488\t1
1\t0\t3\t16\t0\t0\t0\t0\t47.3977450\t8.5455938\t2\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.3977480\t8.5455950\t2\t1
"""
# MAVProxy's own: modules whose libraries are not installed.
HARMLESS = re.compile(r"Failed to load module: No module named")
COMPLAINT = re.compile(r"error|fail|timed? ?out|breach|refus|invalid|lost|retry|down", re.IGNORECASE)


class Session:
    """MAVProxy in a terminal of ours."""

    def __init__(self, endpoint, folder):
        here = os.path.dirname(sys.executable)
        command = [sys.executable, os.path.join(here, "mavproxy.py"), f"--master={endpoint}", "--force-connected"]
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "HOME": folder, "MAVLINK20": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.said = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self.process.stdout:
            self.said.append(line.rstrip())

    def type(self, command):
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()

    def expect(self, pattern):
        """Waits until MAVProxy says something like that."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for line in list(self.said):
                if match := re.search(pattern, line):
                    return match
            time.sleep(0.05)
        sys.exit(f"mavproxy_session: {pattern!r} not said within {PATIENCE_S:.0f} s:\n" + "\n".join(self.said))

    def end(self):
        self.process.kill()  # it ignores gentler requests while its input is open
        self.process.wait()


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    endpoint, folder = sys.argv[1:]
    with open(os.path.join(folder, "mission.txt"), "w", encoding="ascii") as file:
        file.write(MISSION)
    session = Session(endpoint, folder)
    session.expect(r"Detected vehicle")
    count = session.expect(r"Received (\d+) parameters( \(ftp\))?")
    print(f"{count[1]} parameters{' by file' if count[2] else ''}")
    session.type("wp load mission.txt")
    session.expect(r"Loaded (\d+) waypoint")
    session.expect(r"Got MISSION_ACK: TYPE_MISSION: ACCEPTED|Sent all (\d+) waypoints")
    session.type("wp list")
    saved = session.expect(r"Saved (\d+) waypoints")
    print(f"mission of {saved[1]} items")
    session.end()
    complaints = [line for line in session.said if COMPLAINT.search(line) and not HARMLESS.search(line)]
    if complaints:
        sys.exit("mavproxy_session: it complained:\n" + "\n".join(complaints))


if __name__ == "__main__":
    main()
