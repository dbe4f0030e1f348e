/* Products of tables with vectors. Kernels differ in their instructions only (tile.h). Sums within a block are whole numbers, and floats are added in one order: all kernels give
 * the same bits. */
#include "matrix.h"

#include <string.h>

#include "../base/maths.h"

#if defined(__clang__)
#define UNROLL _Pragma("unroll")
#define UNROLL_4 _Pragma("unroll 4")
#else
#define UNROLL _Pragma("GCC unroll 16")
#define UNROLL_4 _Pragma("GCC unroll 4")
#endif

/* Columns of the widest tile. Clang 14 keeps the sums of four in memory, which takes twice as long. */
#if defined(__clang__) && __clang_major__ < 17
#define WIDEST 2
#else
#define WIDEST 4
#endif

#define LEAST_SIZE 1e-30F /* vectors of smaller numbers are zero */

/* Return how many steps make 1, if `steps` of them make the largest number of a block. */
static inline float scale_of(float largest, int steps, float *step) {
    *step = largest / (float)steps;
    return largest > LEAST_SIZE ? (float)steps / largest : 0.0F;
}

/* One unit after its gates. */
static inline float passed(float reset_sum, float update_sum, float given, float kept, float before) {
    const float reset = logistic(reset_sum), update = logistic(update_sum);
    const float candidate = hyperbolic_tangent(given + reset * kept);
    return candidate + update * (before - candidate);
}

static void plain_quantise(const float *x, int inputs, int steps, void *values, float *step) {
    int16_t *value = values;
    for (int first = 0; first < inputs; first += BLOCK, step++) {
        const int end = inputs - first < BLOCK ? inputs : first + BLOCK;
        float largest = 0.0F;
        for (int k = first; k < end; k++) largest = magnitude(x[k]) > largest ? magnitude(x[k]) : largest;
        const float inverse = scale_of(largest, steps, step);
        for (int k = first; k < end; k++) value[k] = (int16_t)rounded(x[k] * inverse);
    }
    if (inputs % 2) value[inputs] = 0;
}

static void plain_gates(const float *given, const float *kept, const float *before, int size, float *after) {
    for (int k = 0; k < size; k++)
        after[k] = passed(given[k] + kept[k], given[size + k] + kept[size + k], given[2 * size + k],
                          kept[2 * size + k], before[k]);
}

static void plain_multiply_table(const table *t, int columns, const float *x, size_t gap, float *y, size_t stride) {
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

static void plain_multiply(const matrix *m, int columns, const void *values, const float *step, float *y,
                           size_t stride) {
    const size_t inputs = (size_t)padded(m->inputs, PAIRS), blocks = (size_t)blocks_of(m->inputs);
    for (size_t group = 0; group < (size_t)grouped(m->rows); group += GROUP) {
        for (size_t c = 0; c < (size_t)columns; c++) {
            const int16_t *value = (const int16_t *)values + c * inputs;
            float total[GROUP] = {0};
            for (size_t first = 0; first < inputs; first += BLOCK) {
                int32_t sum[GROUP] = {0};
                for (size_t k = first; k < inputs && k < first + BLOCK; k += 2) {
                    const int8_t *pair = m->weight + group * inputs + k * GROUP;
                    for (int row = 0; row < GROUP; row++, pair += 2)
                        sum[row] += pair[0] * value[k] + pair[1] * value[k + 1];
                }
                for (int row = 0; row < GROUP; row++) total[row] += (float)sum[row] * step[c * blocks + first / BLOCK];
            }
            for (size_t row = 0; row < GROUP; row++) y[c * stride + group + row] += total[row] * m->step[group + row];
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

/* The bits of two shorts, or of four bytes. */
static inline int32_t bundle_at(const void *p) {
    int32_t bundle;
    memcpy(&bundle, p, sizeof bundle);
    return bundle;
}

static inline const void *unbiased_at(const matrix *m, size_t row, size_t block) {
    return m->unbiased + (row / GROUP * (size_t)blocks_of(m->inputs) + block) * GROUP + row % GROUP;
}

#define NAME(x) avx512vnni_##x
#define TARGET __attribute__((target("avx512f,avx512bw,avx512vnni")))
#define SIMD_WIDTH 16
#define SMALLER(a, b) _mm512_min_ps(a, b)
#define LARGER(a, b) _mm512_max_ps(a, b)
#define SHORT_TALL 4
#define SHORT_WIDE 4
#define SHORT_SUMS __m512i
#define SHORT_WEIGHTS __m512i
#define SHORT_INPUTS __m512i
#define SHORT_START(m, row, block) _mm512_setzero_si512()
#define SHORT_LOAD_WEIGHTS(p) _mm512_cvtepi8_epi16(_mm256_load_si256((const __m256i *)(const void *)(p)))
#define SHORT_LOAD_INPUTS(p) _mm512_set1_epi32(bundle_at(p))
#define SHORT_DOT(sum, w, x) _mm512_dpwssd_epi32(sum, w, x)
#define SHORT_TO_INTEGERS(sum) (sum)
#define BYTE_TALL 4
#define BYTE_WIDE 4
#define BYTE_SUMS __m512i
#define BYTE_WEIGHTS __m512i
#define BYTE_INPUTS __m512i /* + 128, without a sign */
#define BYTE_START(m, row, block) _mm512_load_si512(unbiased_at(m, row, block))
#define BYTE_LOAD_WEIGHTS(p) _mm512_load_si512((const void *)(p))
#define BYTE_LOAD_INPUTS(p) _mm512_set1_epi32(bundle_at(p) ^ (int32_t)0x80808080)
#define BYTE_DOT(sum, w, x) _mm512_dpbusd_epi32(sum, x, w)
#define BYTE_TO_INTEGERS(sum) (sum)
#include "tile.h"

#define NAME(x) avx2_##x
#define TARGET __attribute__((target("avx2")))
#define SIMD_WIDTH 8
#define SMALLER(a, b) _mm256_min_ps(a, b)
#define LARGER(a, b) _mm256_max_ps(a, b)
#define SHORT_TALL 4
#define SHORT_WIDE 2
#define SHORT_SUMS __m256i
#define SHORT_WEIGHTS __m256i
#define SHORT_INPUTS __m256i
#define SHORT_START(m, row, block) _mm256_setzero_si256()
#define SHORT_LOAD_WEIGHTS(p) _mm256_cvtepi8_epi16(_mm_load_si128((const __m128i *)(const void *)(p)))
#define SHORT_LOAD_INPUTS(p) _mm256_set1_epi32(bundle_at(p))
#define SHORT_DOT(sum, w, x) _mm256_add_epi32(sum, _mm256_madd_epi16(w, x))
#define SHORT_TO_INTEGERS(sum) (sum)
#include "tile.h"
#endif

#if defined(__aarch64__)
#include <arm_neon.h>

typedef struct neon_sums { /* of two rows each: two sums a row */
    int32x4_t low, high;
} neon_sums;

static inline neon_sums neon_no_sums(void) { return (neon_sums){vdupq_n_s32(0), vdupq_n_s32(0)}; }

static inline int32x4_t neon_paired(neon_sums sum) { return vpaddq_s32(sum.low, sum.high); }

static inline neon_sums neon_short_dot(neon_sums sum, int16x8_t w, int16x4_t x) {
    return (neon_sums){vmlal_s16(sum.low, vget_low_s16(w), x), vmlal_s16(sum.high, vget_high_s16(w), x)};
}

static inline int16x4_t neon_pair_at(const int16_t *p) {
    int32_t pair;
    memcpy(&pair, p, sizeof pair);
    return vreinterpret_s16_s32(vdup_n_s32(pair));
}

#define NAME(x) neon_##x
#define TARGET
#include "neon.h"
#include "tile.h"

/* Four products in one instruction, since ARMv8.2: known to the compiler, or to Linux. */
#if defined(__ARM_FEATURE_DOTPROD) || defined(__linux__)
#define HAS_NEON_DOT
#define NEON_DOT __attribute__((target("arch=armv8.2-a+dotprod")))

#if defined(__ARM_FEATURE_DOTPROD)
static int has_neon_dot(void) { return 1; }
#else
#include <sys/auxv.h>

static int has_neon_dot(void) { return (getauxval(AT_HWCAP) & (1UL << 20)) != 0; } /* HWCAP_ASIMDDP */
#endif

static inline int8x16_t neon_quad_at(const int8_t *p) {
    int32_t quad;
    memcpy(&quad, p, sizeof quad);
    return vreinterpretq_s8_s32(vdupq_n_s32(quad));
}

#define NAME(x) neondot_##x
#define TARGET NEON_DOT
#include "neon.h"
#define BYTE_TALL 8
#define BYTE_WIDE 4
#define BYTE_SUMS int32x4_t
#define BYTE_WEIGHTS int8x16_t
#define BYTE_INPUTS int8x16_t
#define BYTE_START(m, row, block) vdupq_n_s32(0)
#define BYTE_LOAD_WEIGHTS(p) vld1q_s8(p)
#define BYTE_LOAD_INPUTS(p) neon_quad_at(p)
#define BYTE_DOT(sum, w, x) vdotq_s32(sum, w, x)
#define BYTE_TO_INTEGERS(sum) (sum)
#include "tile.h"
#endif
#endif

#if defined(__wasm_simd128__)
#include <wasm_simd128.h>

#define NAME(x) simd128_##x
#define TARGET
#define SIMD_WIDTH 4
#define SMALLER(a, b) (simd128_floats)wasm_f32x4_pmin((v128_t)(a), (v128_t)(b))
#define LARGER(a, b) (simd128_floats)wasm_f32x4_pmax((v128_t)(a), (v128_t)(b))
#define SHORT_TALL 4
#define SHORT_WIDE 2
#define SHORT_SUMS v128_t
#define SHORT_WEIGHTS v128_t
#define SHORT_INPUTS v128_t
#define SHORT_START(m, row, block) wasm_i32x4_const_splat(0)
#define SHORT_LOAD_WEIGHTS(p) wasm_i16x8_load8x8(p)
#define SHORT_LOAD_INPUTS(p) wasm_v128_load32_splat(p)
#define SHORT_DOT(sum, w, x) wasm_i32x4_add(sum, wasm_i32x4_dot_i16x8(w, x))
#define SHORT_TO_INTEGERS(sum) (sum)
#include "tile.h"
#endif

#define KERNEL(name, multiply_bytes, quantise_bytes)                                                                   \
    {#name, name##_multiply, name##_quantise, multiply_bytes, quantise_bytes, name##_multiply_table, name##_gates}
#define WITH_BYTES(name) KERNEL(name, name##_multiply_bytes, name##_quantise_bytes)

kernel kernel_at(int place) {
    kernel all[KERNELS] = {{.name = "avx512vnni"}, {.name = "avx2"},    {.name = "neondot"},
                           {.name = "neon"},       {.name = "simd128"}, KERNEL(plain, NULL, NULL)};
#if defined(__x86_64__) || defined(__i386__)
    if (has_avx512vnni()) all[0] = (kernel)WITH_BYTES(avx512vnni);
    if (has_avx2()) all[1] = (kernel)KERNEL(avx2, NULL, NULL);
#elif defined(__aarch64__)
#if defined(HAS_NEON_DOT)
    if (has_neon_dot()) all[2] = (kernel)WITH_BYTES(neondot);
#endif
    all[3] = (kernel)KERNEL(neon, NULL, NULL);
#elif defined(__wasm_simd128__)
    all[4] = (kernel)KERNEL(simd128, NULL, NULL);
#endif
    return all[place];
}

kernel fastest_kernel(void) {
    int place = 0;
    while (!kernel_at(place).multiply) place++;
    return kernel_at(place);
}
