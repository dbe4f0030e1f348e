/* Functions of single numbers. They are ours so that every platform computes the same bits, and so that loops over
 * them become vector instructions. Relative errors are a few units in the last place. */
#ifndef BODYSENSE_MATHS_H
#define BODYSENSE_MATHS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF /* gcc: -ffp-contract=off */
#endif

static inline uint32_t bits_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static inline float of_bits(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

#define ROUNDER 12582912.0F /* 1.5 × 2^23: a small number added to it is rounded, and is in its last bits */
#define BITS_OF_ROUNDER 0x4B400000U

static inline float clamp(float x, float low, float high) {
    x = x < low ? low : x; /* one after the other, so that loops over it have no branches */
    return x > high ? high : x;
}

static inline float magnitude(float x) { return of_bits(bits_of(x) & 0x7FFFFFFFU); }

/* The whole number nearest to a small number. */
static inline int32_t rounded(float x) { return (int32_t)(bits_of(x + ROUNDER) - BITS_OF_ROUNDER); }

/* e^x = 2^n e^rest, for vectors too: n is x / ln 2, rounded. */
#define LOG2_E 1.44269504F
#define LN_2_HIGH 0.693145752F /* ln 2 in two parts, so that n × the first is exact */
#define LN_2_LOW 1.42860677e-6F
#define LEAST_EXPONENT (-87.0F) /* e^x is a normal number between these */
#define MOST_EXPONENT 88.0F
#define EXPONENT_SHIFT 23 /* bits of a float below its exponent */
#define BITS_OF_ONE 0x3F800000U

#define EXPONENTIAL_SERIES(r)                                                                                          \
    (1.0F + (r) * (1.0F + (r) * (0.5F + (r) * (1.0F / 6.0F + (r) * (1.0F / 24.0F + (r) * (1.0F / 120.0F +              \
                                                                                        (r) * (1.0F / 720.0F)))))))

/* e^x, between e^-87 and e^88. */
static inline float exponential(float x) {
    x = clamp(x, LEAST_EXPONENT, MOST_EXPONENT);
    const float shifted = x * LOG2_E + ROUNDER, n = shifted - ROUNDER;
    const float rest = x - n * LN_2_HIGH - n * LN_2_LOW;
    return EXPONENTIAL_SERIES(rest) * of_bits((bits_of(shifted) << EXPONENT_SHIFT) + BITS_OF_ONE);
}

/* Natural logarithm of a positive, normal number. */
static inline float logarithm(float x) {
    uint32_t bits = bits_of(x) - 0x3F3504F3U; /* so that the fraction is between √½ and √2 */
    float exponent = (float)((int32_t)bits >> 23);
    float fraction = of_bits((bits & 0x7FFFFFU) + 0x3F3504F3U);
    float s = (fraction - 1.0F) / (fraction + 1.0F), square = s * s;
    float series = 1.0F / 5.0F + square * (1.0F / 7.0F + square * (1.0F / 9.0F));
    return exponent * 0.693147181F + 2.0F * s * (1.0F + square * (1.0F / 3.0F + square * series));
}

static inline float logistic(float x) { return 1.0F / (1.0F + exponential(-x)); }
static inline float hyperbolic_tangent(float x) { return 1.0F - 2.0F / (exponential(2.0F * x) + 1.0F); }

/* log(1 + e^x) */
static inline float softplus(float x) {
    float size = x < 0.0F ? -x : x;
    return (x > 0.0F ? x : 0.0F) + logarithm(1.0F + exponential(-size));
}

/* 2^x */
static inline float power_of_two(float x) { return exponential(0.693147181F * x); }

#define LN_2 0.693147180559945309

/* e^x in double precision, between e^-700 and e^700. */
static inline double exponential_double(double x) {
    x = x < -700.0 ? -700.0 : x > 700.0 ? 700.0 : x;
    const double shifted = x * 1.4426950408889634 + 6755399441055744.0; /* 1.5 × 2^52 */
    const double n = shifted - 6755399441055744.0;
    const double rest = x - n * 0.693147180369123816 - n * 1.90821492927058770e-10;
    double series = 1.0;
    for (int k = 13; k > 0; k--) series = 1.0 + series * rest / k;
    uint64_t bits;
    double power;
    memcpy(&bits, &shifted, sizeof bits);
    bits = (bits << 52) + 0x3FF0000000000000U;
    memcpy(&power, &bits, sizeof power);
    return series * power;
}

/* Natural logarithm of a positive, normal number in double precision. */
static inline double logarithm_double(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits -= 0x3FE6A09E667F3BCDU; /* so that the fraction is between √½ and √2 */
    const double exponent = (double)((int64_t)bits >> 52);
    bits = (bits & 0xFFFFFFFFFFFFFU) + 0x3FE6A09E667F3BCDU;
    memcpy(&x, &bits, sizeof x);
    const double s = (x - 1.0) / (x + 1.0), square = s * s;
    double series = 0.0;
    for (int k = 23; k > 0; k -= 2) series = 1.0 / k + square * series;
    return exponent * LN_2 + 2.0 * s * series;
}

#define QUARTER_TURN 1.57079632679489662

/* Sine and cosine of a few turns at most. */
static inline void sine_cosine(float angle, float *sine, float *cosine) {
    const double turns = angle / QUARTER_TURN;
    const int quarter = (int)(turns + (turns < 0.0 ? -0.5 : 0.5));
    const double rest = angle - quarter * QUARTER_TURN, square = rest * rest;
    double s = 1.0, c = 1.0;
    for (int k = 12; k > 0; k -= 2) {
        s = 1.0 - s * square / ((k + 1) * k);
        c = 1.0 - c * square / (k * (k - 1));
    }
    s *= rest;
    *sine = (float)(quarter & 1 ? c : s) * (quarter & 2 ? -1.0F : 1.0F);
    *cosine = (float)(quarter & 1 ? s : c) * ((quarter + 1) & 2 ? -1.0F : 1.0F);
}

/* The angle of up to half a turn to either side, by its sine and cosine at any scale. */
static inline float angle_of(float sine, float cosine) {
    const double s = (double)magnitude(sine), c = (double)magnitude(cosine);
    if (!(s > 0.0 || c > 0.0)) return 0.0F;
    const double half = s / (c + sqrt(s * s + c * c)); /* the tangent of half of it, at most 1 */
    const double part = half / (1.0 + sqrt(1.0 + half * half)), square = part * part; /* of a quarter */
    double series = 0.0;
    for (int k = 25; k > 0; k -= 2) series = 1.0 / k - square * series;
    const double angle = cosine < 0.0F ? 2.0 * QUARTER_TURN - 4.0 * part * series : 4.0 * part * series;
    return (float)(sine < 0.0F ? -angle : angle);
}

#endif
