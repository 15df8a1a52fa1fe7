"""A patrol as users of ROS 1 write it, for the system's own Python: goals of move_base in a row.

Each argument is FRAME,X,Y; it prints the state and the text of each goal.
"""

# mypy: disable-error-code="import-not-found"
from __future__ import annotations

import sys

import actionlib
import rospy
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal


def main() -> None:
    rospy.init_node("patrol")
    while not rospy.get_time():  # simulated time begins with the first clock
        rospy.rostime.wallsleep(0.02)
    client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
    client.wait_for_server()
    for text in sys.argv[1:]:
        goal = MoveBaseGoal()
        pose = goal.target_pose
        pose.header.frame_id, x, y = text.split(",")
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        client.send_goal_and_wait(goal)
        sys.stdout.write(f"{client.get_state()} {client.get_goal_status_text()}\n")


main()
