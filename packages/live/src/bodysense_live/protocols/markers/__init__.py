"""Live markers from the servers of optical systems: NatNet (OptiTrack), QTM RT (Qualisys), DataStream (Vicon)."""
