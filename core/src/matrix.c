/* Products of tables with vectors. The product is the same for every instruction set (tile.h); here is what each
 * calls its instructions. Sums within a block are whole numbers, and floats are added in one order: all kernels give
 * the same bits. */
#include "matrix.h"

#include <string.h>

#include "maths.h"

#if defined(__clang__)
#define UNROLL _Pragma("unroll")
#define UNROLL_4 _Pragma("unroll 4")
#else
#define UNROLL _Pragma("GCC unroll 16")
#define UNROLL_4 _Pragma("GCC unroll 4")
#endif

#define LARGEST 32767.0F /* of two bytes */

#define SHARED static inline __attribute__((always_inline)) /* each kernel has its own, in its instructions */

SHARED void quantise(const float *x, int inputs, int16_t *value, float *step) {
    for (int first = 0, block = 0; first < inputs; first += BLOCK, block++) {
        const int count = inputs - first < BLOCK ? inputs - first : BLOCK;
        uint32_t largest = 0; /* magnitudes are in the order of their bits */
        for (int k = 0; k < count; k++) {
            const uint32_t bits = bits_of(x[first + k]) & 0x7FFFFFFFU;
            largest = bits > largest ? bits : largest;
        }
        const float size = of_bits(largest);
        const float inverse = size > 1e-30F ? LARGEST / size : 0.0F;
        step[block] = size / LARGEST;
        for (int k = 0; k < count; k++)
            value[first + k] = (int16_t)(int32_t)(bits_of(x[first + k] * inverse + ROUNDER) - bits_of(ROUNDER));
    }
    if (inputs % 2) value[inputs] = 0;
}

SHARED void pass_gates(const float *given, const float *kept, const float *before, int size, float *after) {
    for (int k = 0; k < size; k++) {
        const float reset = logistic(given[k] + kept[k]);
        const float update = logistic(given[size + k] + kept[size + k]);
        const float candidate = hyperbolic_tangent(given[2 * size + k] + reset * kept[2 * size + k]);
        after[k] = candidate + update * (before[k] - candidate);
    }
}

static void plain_quantise(const float *x, int inputs, int16_t *value, float *step) {
    quantise(x, inputs, value, step);
}

static void plain_gates(const float *given, const float *kept, const float *before, int size, float *after) {
    pass_gates(given, kept, before, size, after);
}

static void plain_table(const table *t, int columns, const float *x, size_t gap, float *y, size_t stride) {
    for (int group = 0; group < grouped(t->rows) / GROUP; group++) {
        for (int c = 0; c < columns; c++) {
            const float *weight = t->weight + (size_t)group * (size_t)t->inputs * GROUP, *in = x + (size_t)c * gap;
            float *out = y + (size_t)c * stride + (size_t)group * GROUP;
            for (int k = 0; k < t->inputs; k++, weight += GROUP) {
                for (int row = 0; row < GROUP; row++) out[row] += weight[row] * in[k];
            }
        }
    }
}

static void plain_multiply(const matrix *m, int columns, const int16_t *value, const float *step, float *y,
                           size_t stride) {
    const int pairs = paired(m->inputs) / 2, blocks = blocks_of(m->inputs);
    for (int group = 0; group < grouped(m->rows) / GROUP; group++) {
        const int8_t *weight = m->weight + (size_t)group * (size_t)pairs * 2 * GROUP;
        for (int c = 0; c < columns; c++) {
            const int16_t *input = value + (size_t)c * (size_t)pairs * 2;
            float total[GROUP] = {0};
            for (int block = 0; block < blocks; block++) {
                const int first = block * BLOCK / 2, last = first + BLOCK / 2 < pairs ? first + BLOCK / 2 : pairs;
                int32_t sum[GROUP] = {0};
                for (int pair = first; pair < last; pair++) {
                    for (int row = 0; row < GROUP; row++) {
                        const int8_t *w = weight + ((size_t)pair * GROUP + (size_t)row) * 2;
                        sum[row] += w[0] * input[2 * pair] + w[1] * input[2 * pair + 1];
                    }
                }
                const float size = step[(size_t)c * (size_t)blocks + (size_t)block];
                for (int row = 0; row < GROUP; row++) total[row] += (float)sum[row] * size;
            }
            for (int row = 0; row < GROUP; row++) {
                const size_t at = (size_t)group * GROUP + (size_t)row;
                y[(size_t)c * stride + at] += total[row] * m->step[at];
            }
        }
    }
}

#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>
#include <immintrin.h>

/* Features that the processor has and the system saves. `__builtin_cpu_supports` is always 0 if zig links. */
#define AVX_SAVED 0x06U    /* bits of XCR0 */
#define AVX512_SAVED 0xE6U

static int has(unsigned saved, unsigned wanted_b, unsigned wanted_c) {
    unsigned a, b, c, d, low, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE)) return 0;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    if ((low & saved) != saved || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 0;
    return (b & wanted_b) == wanted_b && (c & wanted_c) == wanted_c;
}

static int has_avx2(void) { return has(AVX_SAVED, bit_AVX2, 0); }
static int has_avx512vnni(void) {
    return has(AVX512_SAVED, bit_AVX512F | bit_AVX512BW, bit_AVX512VNNI);
}

static inline int32_t pair_at(const int16_t *p) {
    int32_t pair;
    memcpy(&pair, p, sizeof pair);
    return pair;
}

#define NAME(x) avx512vnni_##x
#define TARGET __attribute__((target("avx512f,avx512bw,avx512vnni")))
#define SIMD_WIDTH 16
#define MOST_GROUPS 4
#define SUMS __m512i
#define FLOATS __m512
#define WEIGHTS __m512i
#define INPUTS __m512i
#define NO_SUMS _mm512_setzero_si512
#define NO_FLOATS _mm512_setzero_ps
#define LOAD_WEIGHTS(p) _mm512_cvtepi8_epi16(_mm256_load_si256((const __m256i *)(const void *)(p)))
#define LOAD_INPUTS(p) _mm512_set1_epi32(pair_at(p))
#define DOT(sum, w, x) _mm512_dpwssd_epi32(sum, w, x)
#define TO_FLOATS _mm512_cvtepi32_ps
#define SPREAD _mm512_set1_ps
#define MUL _mm512_mul_ps
#define PLUS _mm512_add_ps
#define LOAD_FLOATS _mm512_loadu_ps
#define STORE_FLOATS _mm512_storeu_ps
#include "tile.h"

#define NAME(x) avx2_##x
#define TARGET __attribute__((target("avx2")))
#define SIMD_WIDTH 8
#define MOST_GROUPS 1
#define SUMS __m256i
#define FLOATS __m256
#define WEIGHTS __m256i
#define INPUTS __m256i
#define NO_SUMS _mm256_setzero_si256
#define NO_FLOATS _mm256_setzero_ps
#define LOAD_WEIGHTS(p) _mm256_cvtepi8_epi16(_mm_load_si128((const __m128i *)(const void *)(p)))
#define LOAD_INPUTS(p) _mm256_set1_epi32(pair_at(p))
#define DOT(sum, w, x) _mm256_add_epi32(sum, _mm256_madd_epi16(w, x))
#define TO_FLOATS _mm256_cvtepi32_ps
#define SPREAD _mm256_set1_ps
#define MUL _mm256_mul_ps
#define PLUS _mm256_add_ps
#define LOAD_FLOATS _mm256_loadu_ps
#define STORE_FLOATS _mm256_storeu_ps
#include "tile.h"
#endif

#if defined(__aarch64__)
#include <arm_neon.h>

typedef struct neon_sums { /* of two rows each: the products with both inputs of the pair */
    int32x4_t low, high;
} neon_sums;

static inline neon_sums neon_no_sums(void) { return (neon_sums){vdupq_n_s32(0), vdupq_n_s32(0)}; }

static inline neon_sums neon_dot(neon_sums sum, int16x8_t w, int16x4_t x) {
    return (neon_sums){vmlal_s16(sum.low, vget_low_s16(w), x), vmlal_s16(sum.high, vget_high_s16(w), x)};
}

static inline int16x4_t neon_pair(const int16_t *p) {
    int32_t pair;
    memcpy(&pair, p, sizeof pair);
    return vreinterpret_s16_s32(vdup_n_s32(pair));
}

#define NAME(x) neon_##x
#define TARGET
#define SIMD_WIDTH 4
#define MOST_GROUPS 1
#define SUMS neon_sums
#define FLOATS float32x4_t
#define WEIGHTS int16x8_t
#define INPUTS int16x4_t
#define NO_SUMS neon_no_sums
#define NO_FLOATS() vdupq_n_f32(0.0F)
#define LOAD_WEIGHTS(p) vmovl_s8(vld1_s8(p))
#define LOAD_INPUTS neon_pair
#define DOT neon_dot
#define TO_FLOATS(sum) vcvtq_f32_s32(vpaddq_s32((sum).low, (sum).high))
#define SPREAD vdupq_n_f32
#define MUL vmulq_f32
#define PLUS vaddq_f32
#define LOAD_FLOATS vld1q_f32
#define STORE_FLOATS vst1q_f32
#include "tile.h"
#endif

#if defined(__wasm_simd128__)
#include <wasm_simd128.h>

#define NAME(x) simd128_##x
#define TARGET
#define SIMD_WIDTH 4
#define MOST_GROUPS 1
#define SUMS v128_t
#define FLOATS v128_t
#define WEIGHTS v128_t
#define INPUTS v128_t
#define NO_SUMS() wasm_i32x4_const_splat(0)
#define NO_FLOATS() wasm_f32x4_const_splat(0)
#define LOAD_WEIGHTS(p) wasm_i16x8_load8x8(p)
#define LOAD_INPUTS(p) wasm_v128_load32_splat(p)
#define DOT(sum, w, x) wasm_i32x4_add(sum, wasm_i32x4_dot_i16x8(w, x))
#define TO_FLOATS wasm_f32x4_convert_i32x4
#define SPREAD wasm_f32x4_splat
#define MUL wasm_f32x4_mul
#define PLUS wasm_f32x4_add
#define LOAD_FLOATS wasm_v128_load
#define STORE_FLOATS wasm_v128_store
#include "tile.h"
#endif

#define KERNEL(name) {#name, name##_multiply, name##_table, name##_quantise, name##_gates}

kernel kernel_at(int place) {
    kernel all[KERNELS] = {{"avx512vnni", NULL, NULL, NULL, NULL}, {"avx2", NULL, NULL, NULL, NULL},
                           {"neon", NULL, NULL, NULL, NULL}, {"simd128", NULL, NULL, NULL, NULL}, KERNEL(plain)};
#if defined(__x86_64__) || defined(__i386__)
    if (has_avx512vnni()) all[0] = (kernel)KERNEL(avx512vnni);
    if (has_avx2()) all[1] = (kernel)KERNEL(avx2);
#elif defined(__aarch64__)
    all[2] = (kernel)KERNEL(neon);
#elif defined(__wasm_simd128__)
    all[3] = (kernel)KERNEL(simd128);
#endif
    return all[place];
}

kernel fastest_kernel(void) {
    int place = 0;
    while (!kernel_at(place).run) place++;
    return kernel_at(place);
}
