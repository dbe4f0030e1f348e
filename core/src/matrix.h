/* Products of tables with vectors: weights in bytes × inputs in two bytes, and small tables in floats. */
#ifndef BODYSENSE_MATRIX_H
#define BODYSENSE_MATRIX_H

#include <stddef.h>
#include <stdint.h>

#define GROUP 16  /* rows that are stored together */
#define BLOCK 64  /* inputs that count in one step */

static inline int grouped(int rows) { return (rows + GROUP - 1) / GROUP * GROUP; }
static inline int paired(int inputs) { return (inputs + 1) / 2 * 2; }
static inline int blocks_of(int inputs) { return (inputs + BLOCK - 1) / BLOCK; }

/* Weights that are whole multiples, up to 127, of a step of each row. */
typedef struct matrix {
    const int8_t *weight; /* by 16 rows, pair of inputs, row, input of the pair; zeros fill up rows and inputs */
    const float *step;    /* (rows) */
    int rows, inputs;
} matrix;

/* Weights that are floats. */
typedef struct table {
    const float *weight; /* by 16 rows, input, row */
    int rows, inputs;
} table;

/* Add m x to y for an even number of columns: vectors x as `quantise` gives them, one behind the other, and y of
 * `stride` floats each, with room for whole groups of rows. */
typedef void multiply_add(const matrix *m, int columns, const int16_t *value, const float *step, float *y,
                          size_t stride);

/* Add t x to y for `columns` vectors x of `inputs` floats each, `gap` apart. */
typedef void table_multiply_add(const table *t, int columns, const float *x, size_t gap, float *y, size_t stride);

/* A vector (inputs) → paired(inputs) numbers of two bytes, and of each block what they count in. */
typedef void quantiser(const float *x, int inputs, int16_t *value, float *step);

/* Gates of a recurrent layer: products with inputs and with states, (3 × size) each, and states before → after. */
typedef void gates(const float *given, const float *kept, const float *before, int size, float *after);

/* The functions of one instruction set. All kernels give the same bits. */
typedef struct kernel {
    const char *name;
    multiply_add *run; /* NULL where this processor or this build has none such */
    table_multiply_add *run_table;
    quantiser *quantise;
    gates *gates;
} kernel;

#define KERNELS 5 /* fastest first; the last is plain C */

/* A kernel by its place in 0 … KERNELS - 1. */
kernel kernel_at(int place);

/* The fastest that this processor runs. */
kernel fastest_kernel(void);

#endif
