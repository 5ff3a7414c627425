"""A session of MAVProxy, an independent ground station: it connects, fetches all parameters, and uploads missions.

usage: mavproxy_session.py ENDPOINT FOLDER autopilot|companion|both|mission

ENDPOINT is MAVProxy's, such as udpin:127.0.0.1:14550; its logs and files go into FOLDER. The last word says who is there. With
an autopilot it uploads a mission that the vehicle can do and then one that it cannot; of a companion, 1/191, it wants
heartbeats. With `mission` the autopilot's vehicle flies or drives one to its end, and gets a fence.
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
# Turning a camera's mount is nothing that our vehicles do.
IMPOSSIBLE = MISSION.replace("2\t0\t3\t16", "2\t0\t3\t205")
# From where the simulated vehicles start: up, a few metres and back, or along a few metres and back.
FLIGHT = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t50.7277\t7.0866\t110\t1
1\t0\t3\t22\t0\t0\t0\t0\t0\t0\t2\t1
2\t0\t3\t16\t0\t0\t0\t0\t50.7277180\t7.0866\t2\t1
3\t0\t3\t16\t0.5\t0\t0\t0\t50.7277180\t7.0866200\t2\t1
4\t0\t3\t20\t0\t0\t0\t0\t0\t0\t0\t1
"""
DRIVE = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t50.7277\t7.0866\t110\t1
1\t0\t3\t16\t0\t0\t0\t0\t50.7277\t7.0866200\t0\t1
2\t0\t3\t16\t0.5\t0\t0\t0\t50.7277090\t7.0866400\t0\t1
"""
FENCE = """QGC WPL 110
0\t0\t0\t5001\t3\t0\t0\t0\t50.7276\t7.0865\t0\t1
1\t0\t0\t5001\t3\t0\t0\t0\t50.7276\t7.0868\t0\t1
2\t0\t0\t5001\t3\t0\t0\t0\t50.7279\t7.0866\t0\t1
3\t0\t0\t5004\t2\t0\t0\t0\t50.7278\t7.0866\t0\t1
"""
COMPANION = "1:191"
HEARTBEAT = r"HEARTBEAT \{type : 18, autopilot : 8, .* system_status : 4,"  # an on-board controller that is active
FILES = {
    "mission.txt": MISSION,
    "impossible.txt": IMPOSSIBLE,
    "flight.txt": FLIGHT,
    "drive.txt": DRIVE,
    "fence.txt": FENCE,
}
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

    def expect(self, pattern, times=1):
        """Waits until MAVProxy says something like that, so often."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            matches = [match for line in list(self.said) if (match := re.search(pattern, line))]
            if len(matches) >= times:
                return matches[0]
            time.sleep(0.05)
        self.give_up(pattern)

    def end(self):
        self.process.kill()  # it ignores gentler requests while its input is open
        self.process.wait()


    def ask(self, command, pattern):
        """Types a command again and again until its answer is something like that."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            start = len(self.said)
            self.type(command)
            time.sleep(0.5)
            for line in self.said[start:]:
                if match := re.search(pattern, line):
                    return match
        self.give_up(pattern)

    def give_up(self, pattern):
        sys.exit(f"mavproxy_session: {pattern!r} not said within {PATIENCE_S:.0f} s:\n" + "\n".join(self.said))

    def expect_no_complaint(self):
        complaints = [line for line in self.said if COMPLAINT.search(line) and not HARMLESS.search(line)]
        if complaints:
            sys.exit("mavproxy_session: it complained:\n" + "\n".join(complaints))


def meet_companion(session, alone):
    session.expect(rf"Detected vehicle {COMPANION} on link 0")
    if alone:
        session.type("watch HEARTBEAT")
        session.expect(f"< {HEARTBEAT}", times=3)
    else:
        # What it watches is what comes from the autopilot.
        session.ask("status HEARTBEAT", HEARTBEAT)
    print("companion heard")


def meet_autopilot(session):
    session.expect(r"Detected vehicle \d:1 on link 0")
    count = session.expect(r"Received (\d+) parameters( \(ftp\))?")
    print(f"{count[1]} parameters{' by file' if count[2] else ''}")
    session.type("wp load mission.txt")
    session.expect(r"Loaded (\d+) waypoint")
    session.expect(r"Got MISSION_ACK: TYPE_MISSION: ACCEPTED|Sent all (\d+) waypoints")
    saved = session.ask("wp list", r"Saved (\d+) waypoints")
    print(f"mission of {saved[1]} items")


def fly(session):
    """A whole mission, then a fence."""
    session.expect(r"Detected vehicle \d:1 on link 0")
    session.expect(r"Received (\d+) parameters")
    copter = session.ask("status HEARTBEAT", r"HEARTBEAT \{type : (\d+), autopilot : 3,")[1] == "2"
    session.type(f"wp load {'flight' if copter else 'drive'}.txt")
    session.expect(r"Got MISSION_ACK: TYPE_MISSION: ACCEPTED|Sent all (\d+) waypoints")
    session.type("mode guided")
    session.ask("status HEARTBEAT", rf"custom_mode : {4 if copter else 15},")
    session.type("arm throttle")
    session.expect(r"AP: (Arming motors|Throttle armed)")
    session.type("mode auto")
    session.expect(r"AP: Disarming motors" if copter else r"AP: Mission complete")
    print("mission flown")
    session.type("fence load fence.txt")
    session.expect(r"Got MISSION_ACK: TYPE_FENCE: ACCEPTED|Sent all (\d+) fence")
    saved = session.ask("fence list", r"Saved (\d+) fence")
    print(f"fence of {saved[1]} items")


def fail(session):
    """An upload that the autopilot refuses."""
    session.type("wp load impossible.txt")
    session.expect(r"Got MISSION_ACK: TYPE_MISSION: UNSUPPORTED")
    print("impossible mission refused")


def main():
    if len(sys.argv) != 4 or sys.argv[3] not in ("autopilot", "companion", "both", "mission"):
        sys.exit(__doc__)
    endpoint, folder, whom = sys.argv[1:]
    for name, items in FILES.items():
        with open(os.path.join(folder, name), "w", encoding="ascii") as file:
            file.write(items)
    session = Session(endpoint, folder)
    if whom == "mission":
        fly(session)
        session.expect_no_complaint()
        session.end()
        return
    if whom != "autopilot":
        meet_companion(session, alone=whom == "companion")
    if whom != "companion":
        meet_autopilot(session)
    session.expect_no_complaint()
    if whom != "companion":
        fail(session)
    session.end()


if __name__ == "__main__":
    main()
