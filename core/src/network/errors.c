/* Expected errors, made true by a map that was fitted to what the network errs. */
#include <string.h>

#include "../base/kinematics.h"
#include "../constants.h"
#include "model.h"
#include "network.h"

static const signed char WRIST[2] = {LEFT_WRIST, RIGHT_WRIST};

static float within(float value) { return fminf(fmaxf(value, 0.0F), 1.0F); }

/* By how much bounds are larger because a pose is rare: 1 for those who stand. */
static float rarity(const tracked *t) {
    float low = 0.0F, tilted = 0.0F;
    if (t->has_position[HEAD]) {
        float height = (t->position[HEAD].y - t->floor) / standing_height(t, HEAD);
        low = within((BOUND_LOW_FROM - height) / (BOUND_LOW_FROM - BOUND_LOW_AT));
    }
    if (t->has_rotation[HEAD]) tilted = within((BOUND_TILTED_FROM - t->rotation[HEAD].y.y) / BOUND_TILTED_FROM);
    return 1.0F + BOUND_LOW_MORE * low + BOUND_TILTED_MORE * tilted;
}

static float larger(float a, float b) { return a > b ? a : b; }

void expected_errors(const bs_model *model, const tracked *seen, const prediction *predicted,
                     const float finger_error[2 * HAND_POINTS], const float off[BS_POINTS],
                     float confidence[BS_POINTS], float bound[BS_POINTS]) {
    float known[ERROR_KNOWN + ERROR_HIDDEN], inside[ERROR_HIDDEN];
    float log_error[(2 * BODY_POINTS + GROUP - 1) / GROUP * GROUP]; /* means, then bounds */
    const float strange = fminf(fmaxf(predicted->missed, 1.0F), MISSED_MOST);
    float *to = known;
    for (int k = 0; k < BODY_POINTS; k++)
        *to++ = logarithm(seen->has_position[BODY_POINT[k]] ? TRACKED_ERROR : strange * predicted->error[k]);
    for (int k = 0; k < BODY_POINTS; k++) *to++ = seen->has_position[BODY_POINT[k]] ? 1.0F : 0.0F;
    for (int joint = 0; joint < BODY_JOINTS; joint++) *to++ = seen->has_rotation[joint] ? 1.0F : 0.0F;
    for (int k = 0; k < BODY_POINTS; k++) *to++ = seen->deviation[BODY_POINT[k]];
    for (int joint = 0; joint < BODY_JOINTS; joint++)
        *to++ = logarithm(seen->has_position[joint] ? TRACKED_UNLIKE : predicted->unlike[joint]);
    memcpy(inside, model->error_inward_offset, sizeof inside);
    model->kernel.multiply_table(&model->error_inward, 1, known, 0, inside, 0);
    for (int k = 0; k < ERROR_HIDDEN; k++) *to++ = hyperbolic_tangent(inside[k]);
    memcpy(log_error, model->error_offset, sizeof log_error);
    model->kernel.multiply_table(&model->error_weight, 1, known, 0, log_error, 0);

    float rare = rarity(seen);
    for (int k = 0; k < BODY_POINTS; k++) {
        confidence[BODY_POINT[k]] = exponential(log_error[k]);
        bound[BODY_POINT[k]] = rare * exponential(log_error[BODY_POINTS + k]);
    }
    for (int k = 0; k < 2 * HAND_POINTS; k++) { /* a finger is misplaced by its wrist's error as well */
        const int hand = k / HAND_POINTS, place = k % HAND_POINTS;
        const int point = place < HAND_JOINTS ? (hand ? RIGHT_INDEX1 : LEFT_INDEX1) + place
                                              : (hand ? RIGHT_INDEX_TIP : LEFT_INDEX_TIP) + 2 * (place - HAND_JOINTS);
        const int wrist = WRIST[hand];
        confidence[point] = exponential(log_error[wrist]) + finger_error[k];
        bound[point] = rare * exponential(log_error[BODY_POINTS + wrist]) + finger_error[k] * NORMAL_BOUND;
    }
    for (int p = 0; p < BS_POINTS; p++) {
        if (!seen->has_position[p]) continue;
        confidence[p] = larger(seen->accuracy[p], off[p]);
        bound[p] = NORMAL_BOUND * confidence[p];
    }
}
