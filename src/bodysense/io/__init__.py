"""Files of other programs and the rigs that they come in: BVH, markers, results of video tools, glTF."""
