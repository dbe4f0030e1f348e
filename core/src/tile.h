/* A kernel: products of a few groups of rows with two columns, small tables of floats, and the loops before and after
 * them. Included by matrix.c once for each instruction set, which defines
 *
 *     NAME(x)                  names of this instruction set
 *     TARGET                   attribute of functions that use it
 *     SIMD_WIDTH               rows in a register
 *     MOST_GROUPS              groups whose sums fit the registers
 *     SUMS, FLOATS, WEIGHTS, INPUTS   types: vectors of sums, floats and pairs of weights; a pair of inputs
 *     NO_SUMS(), NO_FLOATS(), LOAD_WEIGHTS(p), LOAD_INPUTS(p), DOT(sums, weights, inputs), TO_FLOATS(sums),
 *     SPREAD(float), MUL(floats, floats), PLUS(floats, floats), LOAD_FLOATS(p), STORE_FLOATS(p, floats)
 */
#define REGISTERS (GROUP / SIMD_WIDTH)
#define COLUMNS 2

TARGET static inline __attribute__((always_inline)) void NAME(tile)(const matrix *m, int group, int groups,
                                                                    const int16_t *value, const float *step,
                                                                    float *y, size_t stride) {
    const size_t pairs = (size_t)paired(m->inputs) / 2, blocks = (size_t)blocks_of(m->inputs);
    const int8_t *weight = m->weight + (size_t)group * pairs * 2 * GROUP;
    FLOATS total[MOST_GROUPS][REGISTERS][COLUMNS];
    UNROLL for (int g = 0; g < groups; g++) {
        UNROLL for (int r = 0; r < REGISTERS; r++) {
            UNROLL for (int c = 0; c < COLUMNS; c++) total[g][r][c] = NO_FLOATS();
        }
    }
    for (size_t block = 0; block < blocks; block++) {
        const size_t first = block * BLOCK / 2, last = first + BLOCK / 2 < pairs ? first + BLOCK / 2 : pairs;
        SUMS sum[MOST_GROUPS][REGISTERS][COLUMNS];
        UNROLL for (int g = 0; g < groups; g++) {
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                UNROLL for (int c = 0; c < COLUMNS; c++) sum[g][r][c] = NO_SUMS();
            }
        }
        UNROLL_4 for (size_t pair = first; pair < last; pair++) {
            INPUTS input[COLUMNS];
            UNROLL for (int c = 0; c < COLUMNS; c++) input[c] = LOAD_INPUTS(value + ((size_t)c * pairs + pair) * 2);
            UNROLL for (int g = 0; g < groups; g++) {
                UNROLL for (int r = 0; r < REGISTERS; r++) {
                    const WEIGHTS w =
                        LOAD_WEIGHTS(weight + ((size_t)g * pairs + pair) * 2 * GROUP + (size_t)r * 2 * SIMD_WIDTH);
                    UNROLL for (int c = 0; c < COLUMNS; c++) sum[g][r][c] = DOT(sum[g][r][c], w, input[c]);
                }
            }
        }
        UNROLL for (int g = 0; g < groups; g++) {
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                UNROLL for (int c = 0; c < COLUMNS; c++) {
                    const FLOATS part = MUL(TO_FLOATS(sum[g][r][c]), SPREAD(step[(size_t)c * blocks + block]));
                    total[g][r][c] = PLUS(total[g][r][c], part);
                }
            }
        }
    }
    UNROLL for (int g = 0; g < groups; g++) {
        UNROLL for (int r = 0; r < REGISTERS; r++) {
            const size_t row = (size_t)(group + g) * GROUP + (size_t)r * SIMD_WIDTH;
            const FLOATS row_step = LOAD_FLOATS(m->step + row);
            UNROLL for (int c = 0; c < COLUMNS; c++) {
                float *at = y + (size_t)c * stride + row;
                STORE_FLOATS(at, PLUS(LOAD_FLOATS(at), MUL(total[g][r][c], row_step)));
            }
        }
    }
}

TARGET static void NAME(multiply)(const matrix *m, int columns, const int16_t *value, const float *step, float *y,
                                  size_t stride) {
    const size_t inputs = (size_t)paired(m->inputs), blocks = (size_t)blocks_of(m->inputs);
    const int groups = grouped(m->rows) / GROUP;
    for (int group = 0; group < groups;) {
        const int together = group + MOST_GROUPS <= groups ? MOST_GROUPS : 1;
        for (size_t column = 0; column < (size_t)columns; column += COLUMNS) {
            const int16_t *x = value + column * inputs;
            if (together == MOST_GROUPS)
                NAME(tile)(m, group, MOST_GROUPS, x, step + column * blocks, y + column * stride, stride);
            else
                NAME(tile)(m, group, 1, x, step + column * blocks, y + column * stride, stride);
        }
        group += together;
    }
}

TARGET static void NAME(table)(const table *t, int columns, const float *x, size_t gap, float *y, size_t stride) {
    for (int group = 0; group < grouped(t->rows) / GROUP; group++) {
        const float *first_weight = t->weight + (size_t)group * (size_t)t->inputs * GROUP;
        for (int c = 0; c < columns; c += 2) { /* two at a time; a last one that is alone is computed twice */
            const size_t first = (size_t)c, second = (size_t)(c + 1 < columns ? c + 1 : c);
            const float *a = x + first * gap, *b = x + second * gap, *weight = first_weight;
            float *to_a = y + first * stride + group * GROUP, *to_b = y + second * stride + group * GROUP;
            FLOATS sum_a[REGISTERS], sum_b[REGISTERS];
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                sum_a[r] = LOAD_FLOATS(to_a + r * SIMD_WIDTH);
                sum_b[r] = LOAD_FLOATS(to_b + r * SIMD_WIDTH);
            }
            for (int k = 0; k < t->inputs; k++, weight += GROUP) {
                UNROLL for (int r = 0; r < REGISTERS; r++) {
                    const FLOATS w = LOAD_FLOATS(weight + r * SIMD_WIDTH);
                    sum_a[r] = PLUS(sum_a[r], MUL(w, SPREAD(a[k])));
                    sum_b[r] = PLUS(sum_b[r], MUL(w, SPREAD(b[k])));
                }
            }
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                STORE_FLOATS(to_a + r * SIMD_WIDTH, sum_a[r]);
                STORE_FLOATS(to_b + r * SIMD_WIDTH, sum_b[r]);
            }
        }
    }
}

TARGET static void NAME(quantise)(const float *x, int inputs, int16_t *value, float *step) {
    quantise(x, inputs, value, step);
}

TARGET static void NAME(gates)(const float *given, const float *kept, const float *before, int size, float *after) {
    pass_gates(given, kept, before, size, after);
}

#undef REGISTERS
#undef NAME
#undef TARGET
#undef SIMD_WIDTH
#undef MOST_GROUPS
#undef COLUMNS
#undef SUMS
#undef FLOATS
#undef WEIGHTS
#undef INPUTS
#undef NO_SUMS
#undef NO_FLOATS
#undef LOAD_WEIGHTS
#undef LOAD_INPUTS
#undef DOT
#undef TO_FLOATS
#undef SPREAD
#undef MUL
#undef PLUS
#undef LOAD_FLOATS
#undef STORE_FLOATS
