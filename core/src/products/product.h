/* Products of a few registers of rows with two or four columns. Included by tile.h for each size of inputs, with
 *
 *     TILE, MULTIPLY           names of the functions
 *     BUNDLE, VALUE            inputs that are stored side by side, and their type
 *     TALL, WIDE               registers of rows in a tile of two columns, and of four: their sums fit the registers
 *     SUMS, WEIGHTS, INPUTS    types: vectors of sums and of bundles of weights; a bundle of inputs
 *     START(m, row, block)     sums of the rows from `row` before the first bundle of a block
 *     LOAD_WEIGHTS(p), LOAD_INPUTS(p), DOT(sums, weights, inputs), TO_FLOATS(sums)
 */
TARGET static inline __attribute__((always_inline)) void TILE(const matrix *m, size_t first_register, int registers,
                                                              int columns, const VALUE *value, const float *step,
                                                              float *y, size_t stride) {
    const size_t bundles = (size_t)padded(m->inputs, BUNDLE) / BUNDLE, blocks = (size_t)blocks_of(m->inputs);
    const size_t group = first_register / REGISTERS, part = first_register % REGISTERS;
    const int8_t *weight = m->weight + (group * bundles * GROUP + part * SIMD_WIDTH) * BUNDLE;
    NAME(floats) total[TALL][4];
    UNROLL for (int r = 0; r < registers; r++) {
        UNROLL for (int c = 0; c < columns; c++) total[r][c] = (NAME(floats)){0};
    }
    for (size_t block = 0; block < blocks; block++) {
        const size_t first = block * BLOCK / BUNDLE, whole = first + BLOCK / BUNDLE;
        const size_t end = whole < bundles ? whole : bundles;
        SUMS sum[TALL][4];
        UNROLL for (int r = 0; r < registers; r++) {
            UNROLL for (int c = 0; c < columns; c++)
                sum[r][c] = START(m, (first_register + (size_t)r) * SIMD_WIDTH, block);
        }
        UNROLL_4 for (size_t bundle = first; bundle < end; bundle++) {
            INPUTS input[4];
            UNROLL for (int c = 0; c < columns; c++)
                input[c] = LOAD_INPUTS(value + ((size_t)c * bundles + bundle) * BUNDLE);
            UNROLL for (int r = 0; r < registers; r++) {
                const size_t at = (size_t)(r / REGISTERS) * bundles * GROUP + bundle * GROUP;
                const WEIGHTS w = LOAD_WEIGHTS(weight + (at + (size_t)(r % REGISTERS) * SIMD_WIDTH) * BUNDLE);
                UNROLL for (int c = 0; c < columns; c++) sum[r][c] = DOT(sum[r][c], w, input[c]);
            }
        }
        UNROLL for (int r = 0; r < registers; r++) {
            UNROLL for (int c = 0; c < columns; c++)
                total[r][c] += TO_FLOATS(sum[r][c]) * step[(size_t)c * blocks + block];
        }
    }
    UNROLL for (int r = 0; r < registers; r++) {
        const size_t row = (first_register + (size_t)r) * SIMD_WIDTH;
        const NAME(floats) row_step = NAME(load)(m->step + row);
        UNROLL for (int c = 0; c < columns; c++) {
            float *at = y + (size_t)c * stride + row;
            NAME(store)(at, NAME(load)(at) + total[r][c] * row_step);
        }
    }
}

TARGET static void MULTIPLY(const matrix *m, int columns, const void *values, const float *step, float *y,
                            size_t stride) {
    const size_t inputs = (size_t)padded(m->inputs, BUNDLE), blocks = (size_t)blocks_of(m->inputs);
    const size_t registers = (size_t)grouped(m->rows) / SIMD_WIDTH;
    for (size_t first = 0; first < registers;) {
        const size_t end = first + TALL <= registers ? first + TALL : first + 1;
        for (size_t column = 0; column < (size_t)columns;) {
            const VALUE *x = (const VALUE *)values + column * inputs;
            const float *of = step + column * blocks;
            float *to = y + column * stride;
            const size_t wide = WIDEST == 4 && column + 4 <= (size_t)columns ? 4 : 2;
            column += wide;
            if (end == first + 1 && wide == 2) TILE(m, first, 1, 2, x, of, to, stride);
            else if (end == first + 1) TILE(m, first, 1, 4, x, of, to, stride);
            else if (wide == 2) TILE(m, first, TALL, 2, x, of, to, stride);
            else
                for (size_t part = first; part < end; part += WIDE) TILE(m, part, WIDE, 4, x, of, to, stride);
        }
        first = end;
    }
}

#undef TILE
#undef MULTIPLY
#undef BUNDLE
#undef VALUE
#undef TALL
#undef WIDE
#undef SUMS
#undef WEIGHTS
#undef INPUTS
#undef START
#undef LOAD_WEIGHTS
#undef LOAD_INPUTS
#undef DOT
#undef TO_FLOATS
