/* The hash of the golden run (test.c). `make golden` writes it anew after a change of results. */
#define GOLDEN 0xA73CA0AE4518575FU
