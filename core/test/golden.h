/* The hash of the golden run (test.c). `make golden` writes it anew after a change of results. */
#define GOLDEN 0x4E3D02557D2F983FU
