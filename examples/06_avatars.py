"""A body for avatars: files that viewers and VRM avatars play, and bones sent live by VMC, here to ourselves."""

import socket
import tempfile
from pathlib import Path

from bodysense.demo import packaged_performance
from bodysense.io.motion_files import write_motion
from bodysense.io.osc import read_packet
from bodysense_live.vmc import vmc_packets
from bodysense_live.vrchat import vrchat_packets

clip = packaged_performance()  # or what a tracker gives, frame by frame

with tempfile.TemporaryDirectory() as folder:
    for name in ("motion.glb", "motion.vrma", "motion.bvh"):
        write_motion(Path(folder) / name, clip)
        print(f"{name}: {(Path(folder) / name).stat().st_size / 1e6:.1f} MB")

with (
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as avatar,
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
):
    avatar.bind(("127.0.0.1", 0))  # an avatar program listens on port 39539
    packets = vmc_packets(clip.pose[100], time=float(clip.time[100]))
    for packet in packets:
        sender.sendto(packet, avatar.getsockname())
    received = [message for _ in packets for message in read_packet(avatar.recv(65536)) if not isinstance(message, str)]

bones = {message.arguments[0]: message.arguments[1:] for message in received if message.address.endswith("Bone/Pos")}
print(f"VMC: {len(bones)} bones in {len(packets)} packets; the hips are at {bones['Hips'][:3]}, in Unity's axes")
print(f"VRChat: {len(vrchat_packets(clip.pose[100])[0])} bytes for eight trackers and the head")
