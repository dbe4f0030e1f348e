/* Product of a few groups of rows with a few columns. Included by matrix.c once for each instruction set, which
 * defines
 *
 *     NAME(x)                  names of this instruction set
 *     TARGET                   attribute of functions that use it
 *     LANES                    rows in a register
 *     MOST_GROUPS, MOST_COLUMNS  how much of a product fits the registers
 *     sums, floats, weights, inputs   types: LANES sums, LANES floats, LANES pairs of weights, a pair of inputs
 *     no_sums(), load_weights(p), load_inputs(p), dot(sums, weights, inputs), to_floats(sums), no_floats(),
 *     mul(floats, float), mul_floats(floats, floats), plus(floats, floats), load_floats(p), store_floats(p, floats)
 */
#define REGISTERS (GROUP / LANES)

TARGET static inline __attribute__((always_inline)) void NAME(tile)(const matrix *m, int group, int groups,
                                                                    int columns, const int16_t *value,
                                                                    const float *step, float *y, size_t stride) {
    const size_t pairs = (size_t)paired(m->inputs) / 2, blocks = (size_t)blocks_of(m->inputs);
    const int8_t *weight = m->weight + (size_t)group * pairs * 2 * GROUP;
    FLOATS total[MOST_GROUPS][REGISTERS][MOST_COLUMNS];
    UNROLL for (int g = 0; g < groups; g++) {
        UNROLL for (int r = 0; r < REGISTERS; r++) {
            UNROLL for (int c = 0; c < columns; c++) total[g][r][c] = NO_FLOATS();
        }
    }
    for (size_t block = 0; block < blocks; block++) {
        const size_t first = block * BLOCK / 2, last = first + BLOCK / 2 < pairs ? first + BLOCK / 2 : pairs;
        SUMS sum[MOST_GROUPS][REGISTERS][MOST_COLUMNS];
        UNROLL for (int g = 0; g < groups; g++) {
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                UNROLL for (int c = 0; c < columns; c++) sum[g][r][c] = NO_SUMS();
            }
        }
        for (size_t pair = first; pair < last; pair++) {
            INPUTS input[MOST_COLUMNS];
            UNROLL for (int c = 0; c < columns; c++) input[c] = LOAD_INPUTS(value + ((size_t)c * pairs + pair) * 2);
            UNROLL for (int g = 0; g < groups; g++) {
                UNROLL for (int r = 0; r < REGISTERS; r++) {
                    const WEIGHTS w =
                        LOAD_WEIGHTS(weight + ((size_t)g * pairs + pair) * 2 * GROUP + (size_t)r * 2 * LANES);
                    UNROLL for (int c = 0; c < columns; c++) sum[g][r][c] = DOT(sum[g][r][c], w, input[c]);
                }
            }
        }
        UNROLL for (int g = 0; g < groups; g++) {
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                UNROLL for (int c = 0; c < columns; c++) {
                    const FLOATS part = MUL(TO_FLOATS(sum[g][r][c]), SPREAD(step[(size_t)c * blocks + block]));
                    total[g][r][c] = PLUS(total[g][r][c], part);
                }
            }
        }
    }
    UNROLL for (int g = 0; g < groups; g++) {
        UNROLL for (int r = 0; r < REGISTERS; r++) {
            const size_t row = (size_t)(group + g) * GROUP + (size_t)r * LANES;
            const FLOATS row_step = LOAD_FLOATS(m->step + row);
            UNROLL for (int c = 0; c < columns; c++) {
                float *at = y + (size_t)c * stride + row;
                STORE_FLOATS(at, PLUS(LOAD_FLOATS(at), MUL(total[g][r][c], row_step)));
            }
        }
    }
}

TARGET static void NAME(multiply)(const matrix *m, int columns, const int16_t *value, const float *step, float *y,
                                  size_t stride) {
    const size_t pairs = (size_t)paired(m->inputs) / 2, blocks = (size_t)blocks_of(m->inputs);
    const int groups = grouped(m->rows) / GROUP;
    for (int group = 0; group < groups;) {
        const int together = group + MOST_GROUPS <= groups ? MOST_GROUPS : 1;
        for (int column = 0; column < columns;) {
            const int beside = column + MOST_COLUMNS <= columns ? MOST_COLUMNS : 2;
            const int16_t *x = value + (size_t)column * pairs * 2;
            const float *s = step + (size_t)column * blocks;
            float *out = y + (size_t)column * stride;
            if (together == MOST_GROUPS && beside == MOST_COLUMNS)
                NAME(tile)(m, group, MOST_GROUPS, MOST_COLUMNS, x, s, out, stride);
            else if (together == MOST_GROUPS)
                NAME(tile)(m, group, MOST_GROUPS, 2, x, s, out, stride);
            else if (beside == MOST_COLUMNS)
                NAME(tile)(m, group, 1, MOST_COLUMNS, x, s, out, stride);
            else
                NAME(tile)(m, group, 1, 2, x, s, out, stride);
            column += beside;
        }
        group += together;
    }
}

#undef REGISTERS
#undef NAME
#undef TARGET
#undef LANES
#undef MOST_GROUPS
#undef MOST_COLUMNS
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
