"""Compares a rosbag2 recording with a forces.csv by plain sqlite3 and struct; knows nothing of this project's code.

Usage: bag_against_csv.py BAG FORCES.csv [--every]
Each row of the CSV, in order, must have a pose and a wrench of one time in the bag that print as the row does:
positions to 9 digits, forces and torques to 6. --every: and the bag has no other.
"""
import csv
import glob
import sqlite3
import struct
import sys


def header(data):
    assert data[:2] == b"\x00\x01", "little-endian CDR"
    seconds, nanoseconds, length = struct.unpack_from("<iII", data, 4)
    frame = data[16:16 + length - 1].decode()
    assert data[16 + length - 1] == 0
    return seconds * 10**9 + nanoseconds, frame, 4 + (12 + length + 7) // 8 * 8


def doubles(data, count):
    _, _, at = header(data)
    assert len(data) == at + 8 * count, "nothing is left over"
    return struct.unpack_from("<%dd" % count, data, at)


def main(bag, forces, every):
    database = sqlite3.connect("file:%s?mode=ro" % glob.glob(bag + "/*.db3")[0], uri=True)
    topics = {name: (number, kind) for number, name, kind in database.execute("SELECT id, name, type FROM topics")}
    pose_topic = next(n for n, (_, kind) in topics.items() if kind == "geometry_msgs/msg/PoseStamped")
    wrench_topic = pose_topic.replace("/pose", "/wrench")
    assert topics[wrench_topic][1] == "geometry_msgs/msg/WrenchStamped"

    def messages(topic):
        return database.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp",
                                (topics[topic][0],))

    wrenches = {time: doubles(data, 6) for time, data in messages(wrench_topic)}
    ticks = []
    late = 0
    for time, data in messages(pose_topic):
        stamp, frame, _ = header(data)
        # Or was waited for: haptic/loop.h, late_state_ns; where the machine woke the tick late, longer.
        assert abs(time - stamp) < 50 * 10**6, "the state came %d ns before its tick" % (time - stamp)
        late += time - stamp < -4 * 10**5
        assert frame == pose_topic.split("/")[1] + "_" + pose_topic.split("/")[2]
        ticks.append((["%.9g" % v for v in doubles(data, 7)[:3]], ["%.6g" % v for v in wrenches[time]]))

    assert late <= len(ticks) / 100, "%d of %d states came 0.4 ms after their tick" % (late, len(ticks))

    with open(forces) as file:
        rows = list(csv.DictReader(file))
    at = 0
    for row in rows:
        wanted = ([row[k] for k in ("px", "py", "pz")], [row[k] for k in ("fx", "fy", "fz", "tx", "ty", "tz")])
        while at < len(ticks) and ticks[at] != wanted:
            assert not every, "slot %s: %s in the bag, %s in the CSV" % (row["number"], ticks[at], wanted)
            at += 1
        assert at < len(ticks), "slot %s is not in the bag: %s" % (row["number"], wanted)
        at += 1
    assert not every or at == len(ticks)
    assert max(abs(float(v)) for row in rows for v in (row["fx"], row["fy"], row["fz"])) > 1e-3, "there was a force"
    print("%d rows agree; %d poses and %d wrenches in the bag" % (len(rows), len(ticks), len(wrenches)))


main(sys.argv[1], sys.argv[2], "--every" in sys.argv)
