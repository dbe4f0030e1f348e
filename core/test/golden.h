/* The hash of the golden run (test.c). `make golden` writes it anew after a change of results. */
#define GOLDEN 0xFE9F49A97B28DF43U
