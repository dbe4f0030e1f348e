/* Vectors and 16-bit products of NEON, which both of its kernels have. */
#define SIMD_WIDTH 4
#define SMALLER(a, b) vminq_f32(a, b)
#define LARGER(a, b) vmaxq_f32(a, b)
#define SHORT_TALL 4
#define SHORT_WIDE 2
#define SHORT_SUMS neon_sums
#define SHORT_WEIGHTS int16x8_t
#define SHORT_INPUTS int16x4_t
#define SHORT_START(m, row, block) neon_no_sums()
#define SHORT_LOAD_WEIGHTS(p) vmovl_s8(vld1_s8(p))
#define SHORT_LOAD_INPUTS(p) neon_pair_at(p)
#define SHORT_DOT(sum, w, x) neon_short_dot(sum, w, x)
#define SHORT_TO_INTEGERS(sum) neon_paired(sum)
