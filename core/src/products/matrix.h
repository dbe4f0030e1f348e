/* Products of tables with vectors: weights in bytes × inputs in one or two bytes, and small tables in floats.
 *
 * States of recurrent layers are read in one byte, which costs no accuracy, and features in two, because the last bits
 * of their byte would show in the jerk of the body.
 */
#ifndef BODYSENSE_MATRIX_H
#define BODYSENSE_MATRIX_H

#include <stddef.h>
#include <stdint.h>

#define GROUP 16  /* rows that are stored together */
#define BLOCK 64  /* inputs that share one step */

/* Inputs of a row that are stored side by side: */
#define PAIRS 2 /* of inputs in two bytes */
#define QUADS 4 /* of inputs in one byte, for kernels with an instruction for four products */

/* Steps that make the largest number of a block. */
#define FEATURE_STEPS 32767
#define STATE_STEPS 127

static inline int grouped(int rows) { return (rows + GROUP - 1) / GROUP * GROUP; }
static inline int padded(int inputs, int bundle) { return (inputs + bundle - 1) / bundle * bundle; }
static inline int blocks_of(int inputs) { return (inputs + BLOCK - 1) / BLOCK; }

/* Weights that are whole multiples, up to 127, of a step of each row. */
typedef struct matrix {
    const int8_t *weight;    /* by 16 rows, bundle, row, input of the bundle; zeros fill up rows and inputs */
    const int32_t *unbiased; /* by 16 rows, block, row: −128 × the sum of the block's weights. QUADS only */
    const float *step;       /* (rows) */
    int rows, inputs;
    int bundle; /* PAIRS or QUADS */
} matrix;

/* Weights that are floats. */
typedef struct table {
    const float *weight; /* by 16 rows, input, row */
    int rows, inputs;
} table;

/* Add m x to y for an even number of columns: vectors x as a quantiser writes them, one after the other, and y of
 * `stride` floats each, with room for whole groups of rows. */
typedef void multiply_add(const matrix *m, int columns, const void *value, const float *step, float *y,
                          size_t stride);

/* Add t x to y for `columns` vectors x of `inputs` floats each, `gap` apart. */
typedef void table_multiply_add(const table *t, int columns, const float *x, size_t gap, float *y, size_t stride);

/* A vector (inputs) → padded(inputs, bundle) whole numbers up to `steps`, and the step of each block. */
typedef void quantiser(const float *x, int inputs, int steps, void *value, float *step);

/* Gates of a recurrent layer: products with inputs and with states, (3 × size) each, and states before → after. */
typedef void gates(const float *given, const float *kept, const float *before, int size, float *after);

/* The functions of one instruction set. All kernels give the same bits. */
typedef struct kernel {
    const char *name;
    multiply_add *multiply; /* of PAIRS; NULL if this processor or this build does not have the kernel */
    quantiser *quantise;
    multiply_add *multiply_bytes; /* of QUADS, which read states; NULL: states are read in pairs, which is as fast */
    quantiser *quantise_bytes;
    table_multiply_add *multiply_table;
    gates *gates;
} kernel;

/* How inputs of up to `steps` are read. */
static inline int bundle_of(const kernel *k, int steps) {
    return steps == STATE_STEPS && k->multiply_bytes ? QUADS : PAIRS;
}

#define KERNELS 6 /* fastest first; the last is plain C */

/* A kernel by its place in 0 … KERNELS - 1. */
kernel kernel_at(int place);

/* The fastest that this processor runs. */
kernel fastest_kernel(void);

#endif
