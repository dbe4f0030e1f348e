"""glTF 2.0 and VRM animations: readers and writers of motion."""
