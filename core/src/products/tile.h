/* A kernel: products (product.h), small tables of floats, and the loops before and after them. Its vectors are those
 * of the compiler, so that no loop depends on its optimiser. Included by matrix.c once for each instruction set, with
 *
 *     NAME(x)                  names of this instruction set
 *     TARGET                   attribute of functions that use it
 *     SIMD_WIDTH               rows in a register
 *     SMALLER, LARGER          of two vectors of floats, element by element
 *     SHORT_TALL, SHORT_WIDE, SHORT_SUMS, …    product.h's, of inputs in two bytes
 *     BYTE_TALL, BYTE_WIDE, BYTE_SUMS, …       product.h's, of inputs in one byte, if the instruction set has them
 */
#define REGISTERS (GROUP / SIMD_WIDTH)

typedef float NAME(floats) __attribute__((vector_size(4 * SIMD_WIDTH)));
typedef int32_t NAME(integers) __attribute__((vector_size(4 * SIMD_WIDTH)));
typedef uint32_t NAME(bits) __attribute__((vector_size(4 * SIMD_WIDTH)));
typedef int16_t NAME(shorts) __attribute__((vector_size(2 * SIMD_WIDTH)));
typedef int8_t NAME(bytes) __attribute__((vector_size(SIMD_WIDTH)));

TARGET static inline __attribute__((always_inline)) NAME(floats) NAME(load)(const float *p) {
    NAME(floats) x;
    memcpy(&x, p, sizeof x);
    return x;
}

TARGET static inline __attribute__((always_inline)) void NAME(store)(float *p, NAME(floats) x) {
    memcpy(p, &x, sizeof x);
}

#define TILE NAME(short_tile)
#define MULTIPLY NAME(multiply)
#define BUNDLE PAIRS
#define VALUE int16_t
#define TALL SHORT_TALL
#define WIDE SHORT_WIDE
#define SUMS SHORT_SUMS
#define WEIGHTS SHORT_WEIGHTS
#define INPUTS SHORT_INPUTS
#define START SHORT_START
#define LOAD_WEIGHTS SHORT_LOAD_WEIGHTS
#define LOAD_INPUTS SHORT_LOAD_INPUTS
#define DOT SHORT_DOT
#define TO_FLOATS(sums) __builtin_convertvector((NAME(integers))SHORT_TO_INTEGERS(sums), NAME(floats))
#include "product.h"

#if defined(BYTE_TALL)
#define TILE NAME(byte_tile)
#define MULTIPLY NAME(multiply_bytes)
#define BUNDLE QUADS
#define VALUE int8_t
#define TALL BYTE_TALL
#define WIDE BYTE_WIDE
#define SUMS BYTE_SUMS
#define WEIGHTS BYTE_WEIGHTS
#define INPUTS BYTE_INPUTS
#define START BYTE_START
#define LOAD_WEIGHTS BYTE_LOAD_WEIGHTS
#define LOAD_INPUTS BYTE_LOAD_INPUTS
#define DOT BYTE_DOT
#define TO_FLOATS(sums) __builtin_convertvector((NAME(integers))BYTE_TO_INTEGERS(sums), NAME(floats))
#include "product.h"
#endif

TARGET static void NAME(multiply_table)(const table *t, int columns, const float *x, size_t gap, float *y,
                                        size_t stride) {
    for (int group = 0; group < grouped(t->rows) / GROUP; group++) {
        const float *first_weight = t->weight + (size_t)group * (size_t)t->inputs * GROUP;
        for (int c = 0; c < columns; c += 2) { /* two at a time; a last one that is alone is computed twice */
            const size_t first = (size_t)c, second = (size_t)(c + 1 < columns ? c + 1 : c);
            const float *a = x + first * gap, *b = x + second * gap, *weight = first_weight;
            float *to_a = y + first * stride + group * GROUP, *to_b = y + second * stride + group * GROUP;
            NAME(floats) sum_a[REGISTERS], sum_b[REGISTERS];
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                sum_a[r] = NAME(load)(to_a + r * SIMD_WIDTH);
                sum_b[r] = NAME(load)(to_b + r * SIMD_WIDTH);
            }
            for (int k = 0; k < t->inputs; k++, weight += GROUP) {
                UNROLL for (int r = 0; r < REGISTERS; r++) {
                    const NAME(floats) w = NAME(load)(weight + r * SIMD_WIDTH);
                    sum_a[r] += w * a[k];
                    sum_b[r] += w * b[k];
                }
            }
            UNROLL for (int r = 0; r < REGISTERS; r++) {
                NAME(store)(to_a + r * SIMD_WIDTH, sum_a[r]);
                NAME(store)(to_b + r * SIMD_WIDTH, sum_b[r]);
            }
        }
    }
}

TARGET static inline __attribute__((always_inline)) float NAME(largest)(const float *x, int count) {
    float lane[SIMD_WIDTH], largest = 0.0F;
    NAME(floats) most = {0};
    int k = 0;
    for (; k + SIMD_WIDTH <= count; k += SIMD_WIDTH)
        most = LARGER((NAME(floats))((NAME(bits))NAME(load)(x + k) & 0x7FFFFFFFU), most);
    NAME(store)(lane, most);
    for (int n = 0; n < SIMD_WIDTH; n++) largest = lane[n] > largest ? lane[n] : largest;
    for (; k < count; k++) {
        const float size = magnitude(x[k]);
        largest = size > largest ? size : largest;
    }
    return largest;
}

TARGET static inline __attribute__((always_inline)) NAME(integers) NAME(rounded)(const float *x, float inverse) {
    return (NAME(integers))((NAME(bits))(NAME(load)(x) * inverse + ROUNDER) - BITS_OF_ROUNDER);
}

TARGET static void NAME(quantise)(const float *x, int inputs, int steps, void *values, float *step) {
    int16_t *value = values;
    for (int first = 0; first < inputs; first += BLOCK, step++) {
        const int end = inputs - first < BLOCK ? inputs : first + BLOCK;
        int k = first;
        const float inverse = scale_of(NAME(largest)(x + first, end - first), steps, step);
        for (; k + SIMD_WIDTH <= end; k += SIMD_WIDTH) {
            const NAME(shorts) few = __builtin_convertvector(NAME(rounded)(x + k, inverse), NAME(shorts));
            memcpy(value + k, &few, sizeof few);
        }
        for (; k < end; k++) value[k] = (int16_t)rounded(x[k] * inverse);
    }
    if (inputs % 2) value[inputs] = 0;
}

#if defined(BYTE_TALL)
TARGET static void NAME(quantise_bytes)(const float *x, int inputs, int steps, void *values, float *step) {
    int8_t *value = values;
    for (int first = 0; first < inputs; first += BLOCK, step++) {
        const int end = inputs - first < BLOCK ? inputs : first + BLOCK;
        int k = first;
        const float inverse = scale_of(NAME(largest)(x + first, end - first), steps, step);
        for (; k + SIMD_WIDTH <= end; k += SIMD_WIDTH) {
            const NAME(bytes) few = __builtin_convertvector(NAME(rounded)(x + k, inverse), NAME(bytes));
            memcpy(value + k, &few, sizeof few);
        }
        for (; k < end; k++) value[k] = (int8_t)rounded(x[k] * inverse);
    }
    for (int k = inputs; k < padded(inputs, QUADS); k++) value[k] = 0;
}
#endif

TARGET static inline __attribute__((always_inline)) NAME(floats) NAME(exponential)(NAME(floats) x) {
    x = LARGER(x, (NAME(floats)){0} + LEAST_EXPONENT);
    x = SMALLER(x, (NAME(floats)){0} + MOST_EXPONENT);
    const NAME(floats) shifted = x * LOG2_E + ROUNDER, n = shifted - ROUNDER;
    const NAME(floats) rest = x - n * LN_2_HIGH - n * LN_2_LOW;
    return EXPONENTIAL_SERIES(rest) * (NAME(floats))(((NAME(bits))shifted << EXPONENT_SHIFT) + BITS_OF_ONE);
}

TARGET static void NAME(gates)(const float *given, const float *kept, const float *before, int size, float *after) {
    int k = 0;
    for (; k + SIMD_WIDTH <= size; k += SIMD_WIDTH) {
        const NAME(floats) reset_sum = NAME(load)(given + k) + NAME(load)(kept + k);
        const NAME(floats) update_sum = NAME(load)(given + size + k) + NAME(load)(kept + size + k);
        const NAME(floats) reset = 1.0F / (1.0F + NAME(exponential)(-reset_sum));
        const NAME(floats) update = 1.0F / (1.0F + NAME(exponential)(-update_sum));
        const NAME(floats) sum = NAME(load)(given + 2 * size + k) + reset * NAME(load)(kept + 2 * size + k);
        const NAME(floats) candidate = 1.0F - 2.0F / (NAME(exponential)(2.0F * sum) + 1.0F);
        NAME(store)(after + k, candidate + update * (NAME(load)(before + k) - candidate));
    }
    for (; k < size; k++)
        after[k] = passed(given[k] + kept[k], given[size + k] + kept[size + k], given[2 * size + k],
                          kept[2 * size + k], before[k]);
}

#undef REGISTERS
#undef NAME
#undef TARGET
#undef SIMD_WIDTH
#undef SMALLER
#undef LARGER
#undef SHORT_TALL
#undef SHORT_WIDE
#undef SHORT_SUMS
#undef SHORT_WEIGHTS
#undef SHORT_INPUTS
#undef SHORT_START
#undef SHORT_LOAD_WEIGHTS
#undef SHORT_LOAD_INPUTS
#undef SHORT_DOT
#undef SHORT_TO_INTEGERS
#undef BYTE_TALL
#undef BYTE_WIDE
#undef BYTE_SUMS
#undef BYTE_WEIGHTS
#undef BYTE_INPUTS
#undef BYTE_START
#undef BYTE_LOAD_WEIGHTS
#undef BYTE_LOAD_INPUTS
#undef BYTE_DOT
#undef BYTE_TO_INTEGERS
