"""A ROS bag as a CSV for `holdfast identify --from`: python bag_to_csv.py FOLDER > dive.csv."""

import csv
import sys
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
store.register(get_types_from_msg("uint16[18] channels\n", "mavros_msgs/msg/OverrideRCIn"))
out = csv.writer(sys.stdout)
sys.stdout.write("t_s,pitch,roll,heave,yaw,surge,sway,z_m,u_mps,v_mps,w_mps,p_radps,q_radps,r_radps\r\n")
with AnyReader([Path(sys.argv[1])], default_typestore=store) as bag:
    chosen = [one for one in bag.connections if one.msgtype.endswith(("OverrideRCIn", "Odometry"))]
    for connection, t_ns, data in bag.messages(connections=chosen):
        message = bag.deserialize(data, connection.msgtype)
        if connection.msgtype.endswith("OverrideRCIn"):
            stick = [(us - 1500) / 400 if 800 <= us <= 2200 else 0 for us in map(int, message.channels[:6])]
            out.writerow([t_ns / 1e9, *stick[:2], -stick[2], *stick[3:]])
        else:  # ENU and FLU become NED and FRD
            v, w = message.twist.twist.linear, message.twist.twist.angular
            z_m = -message.pose.pose.position.z
            out.writerow([t_ns / 1e9, *[""] * 6, z_m, v.x, -v.y, -v.z, w.x, -w.y, -w.z])
