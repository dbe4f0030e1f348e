/* The hash of the golden run (test.c). `make golden` writes it anew after a change of results. */
#define GOLDEN 0x842E6018BFAB28CAU
