"""The live server under load: hostile clients and packets, a bad network, decoders that are not ours."""
