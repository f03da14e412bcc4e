"""Third-party clients drive the simulated arm: pydobot and pydobotplus.

Usage: dobot_clients.py PORT. Prints one JSON object; exits 1 with a reason when a client
does not get the expected answer.
"""

import json
import sys


def near(found, wanted, what):
    if any(abs(a - b) > 0.01 for a, b in zip(found, wanted)):
        sys.exit(f"{what}: at {found}, wanted {wanted}")


def pydobot(port):
    from pydobot import Dobot

    arm = Dobot(port)
    start = arm.pose()
    arm.move_to(200.0, 50.0, 20.0, 10.0, wait=True)
    end = arm.pose()
    near(end[:4], (200.0, 50.0, 20.0, 10.0), "pydobot")
    arm.wait(10)
    arm.suck(True)
    arm.grip(False)
    arm.close()
    return {"start": start, "end": end}


def pydobotplus(port):
    from pydobotplus import Dobot

    arm = Dobot(port)
    start = arm.get_pose()
    arm.move_to(220.0, -30.0, 30.0, 0.0, wait=True)
    end = arm.get_pose()
    near(end.position, (220.0, -30.0, 30.0, 0.0), "pydobotplus")
    alarms = sorted(int(alarm) for alarm in arm.get_alarms())
    if alarms:
        sys.exit(f"pydobotplus: alarms {alarms}")
    arm.close()
    return {"start": start.position, "end": end.position}


def main():
    port = sys.argv[1]
    print(json.dumps({"pydobot": pydobot(port), "pydobotplus": pydobotplus(port)}))


if __name__ == "__main__":
    main()
