"""Files of other programs: markers, results of video tools, glTF."""
