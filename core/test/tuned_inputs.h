/* Limits of inputs, and numbers of the network's features. */
#ifndef BODYSENSE_TUNED_INPUTS_H
#define BODYSENSE_TUNED_INPUTS_H

#include "../src/network/features.h"
#include "tuned_limbs.h"

/* ---- inputs and features ----------------------------------------------------------------------------------------- */

/* The result of a frame with a head alone, and how far it is expected to be off (m). */
static bs_result one_frame(const bs_model *model, const bs_settings *settings, double x, double size, double accuracy,
                           double *expected) {
    static double root[3], rotation[BS_JOINTS][4], points[BS_POINTS][3], confidence[BS_POINTS], bound[BS_POINTS];
    static double contact[BS_CONTACTS], rest_offset[BS_POINTS][3];
    static uint8_t measured[BS_POINTS];
    const int32_t point = HEAD;
    const uint8_t yes = 1;
    const double time = 0, position[3] = {x, 1.6, 0}, q[4] = {size, 0, 0, 0};
    const bs_observation seen = {1, 1, &point, &time, position, q, &yes, &yes, &accuracy, NULL};
    const bs_estimate out = {root, rotation[0], points[0], measured, confidence, bound, contact, rest_offset[0]};
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    bs_state *state;
    int refused;
    const size_t bytes = bs_state_size(model), scratch_bytes = bs_scratch_size(model, 1);
    void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
    void *scratch = aligned_alloc(64, (scratch_bytes + 63) / 64 * 64);
    if (!memory || !scratch || bs_person_likeliest(model, &person) != BS_OK ||
        bs_state_start(model, &person, memory, bytes, &state) != BS_OK)
        exit(1);
    const bs_result done = bs_step(model, settings, 1, &seen, &state, &out, scratch, scratch_bytes, &refused);
    if (expected) *expected = confidence[HEAD];
    free(scratch);
    free(memory);
    return done;
}

static bool refuses(const bs_model *model, double x, double size) {
    const bs_settings settings = bs_default_settings();
    return one_frame(model, &settings, x, size, 0.001, NULL) != BS_OK;
}

static double input_farthest(const bs_model *m) { LEAST(0, 9000, refuses(m, at, 1)); }
static double input_unit(const bs_model *m) { LEAST(0, 1, refuses(m, 0, 1 + at)); }

static double expected_for(const bs_model *model, double accuracy) {
    const bs_settings settings = bs_default_settings();
    double expected = 0;
    one_frame(model, &settings, 0, 1, accuracy, &expected);
    return expected;
}

static double input_finest(const bs_model *m) { return expected_for(m, 1e-7); }
static double input_coarsest(const bs_model *m) { return expected_for(m, 1e7); }

static bool takes(const bs_model *model, double ease, double first, double longest) {
    bs_settings settings = bs_default_settings();
    settings.ease = ease;
    settings.first = first;
    settings.longest = longest;
    return one_frame(model, &settings, 0, 1, 0.001, NULL) == BS_OK;
}

static double longest_ease(const bs_model *m) { LEAST(1, 90, !takes(m, at, 0.03, 0.1)); }
static double shortest_interval(const bs_model *m) { LEAST(0, 0.1, takes(m, 0, at, 0.1)); }
static double longest_interval(const bs_model *m) { LEAST(1, 90, !takes(m, 0, 0.03, at)); }

/* A feature of a head that is 100 m away, was 1 m from there, spins, and is accurate to 1 nm. */
static double feature(const bs_model *model, size_t place) {
    static float out[FEATURES_ACCELERATION + 64];
    static body b;
    static input_memory last;
    tracked t = rest_of(model, &b);
    const int head = 15; /* of `BODY_POINT` */
    memset(&last, 0, sizeof last);
    t.position[HEAD] = vec(100, 0, 0);
    t.has_rotation[HEAD] = true;
    t.accuracy[HEAD] = 1e-9F;
    t.deviation[HEAD] = 0.05F;
    last.cosine = last.had_axes[0] = 1.0F;
    last.had_place[head] = 1.0F;
    last.axis[0][0] = vec(9, 9, 9);
    const reading read = read_person(&t, &last);
    write_features(model, &t, &read, (head_frame){vec(0, 0, 0), 1, 0}, &last, false, out);
    const size_t start = place == 2 ? 8 * READ_POINTS + 7 * BODY_JOINTS : place * READ_POINTS + 3 * (size_t)head;
    if (place == 3) return (double)out[7 * READ_POINTS + head];
    if (place == 2) return (double)fabsf(out[start]);
    return sqrt((double)(out[start] * out[start] + out[start + 1] * out[start + 1] + out[start + 2] * out[start + 2]));
}

static double feature_reach(const bs_model *m) { return feature(m, 0); }
static double feature_fastest(const bs_model *m) { return feature(m, 4); }
static double feature_swiftest(const bs_model *m) { return feature(m, 0) - feature(m, 2); } /* as REACH is near */
static double feature_finest(const bs_model *m) { return feature(m, 3); }

static double reference_head(const bs_model *model) {
    static body b;
    const tracked t = rest_of(model, &b);
    return (double)(standing_height(&t, HEAD) / stature(t.rest_offset));
}

static double normal_bound(const bs_model *model) {
    static body b;
    static prediction p;
    static float finger[2 * HAND_POINTS], off[BS_POINTS], confidence[BS_POINTS], bound[BS_POINTS];
    tracked t = rest_of(model, &b);
    for (int k = 0; k < BODY_POINTS; k++) p.error[k] = 0.05F;
    for (int j = 0; j < BODY_JOINTS; j++) p.unlike[j] = 0.05F;
    t.accuracy[HEAD] = 0.01F;
    expected_errors(model, &t, &p, finger, off, confidence, bound);
    return (double)(bound[HEAD] / confidence[HEAD]);
}

#endif
