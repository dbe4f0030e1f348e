/* Numbers of balance. */
#ifndef BODYSENSE_TUNED_BALANCE_H
#define BODYSENSE_TUNED_BALANCE_H

#include <string.h>

#include "../src/body/balance.h"
#include "measure.h"
#include "tuned_limbs.h"

/* A predicted body that leans by `angle` (rad) about its head, forward if it is positive, and its state. */
typedef struct leaning {
    tracked seen;
    pose_state state;
    prediction predicted;
} leaning;

static void predict_leaning(leaning *l, double angle) {
    for (int j = 0; j < BODY_JOINTS; j++) l->predicted.rotation[j] = turned_by(identity(), vec((float)angle, 0, 0));
    for (int k = 0; k < BS_CONTACTS; k++) l->predicted.contact[k] = 1.0F;
}

/* `high`: the head's height, of that of a body that stands. `speed`: m/s of the head along the floor. */
static void lean(leaning *l, const bs_model *model, double angle, double high, double speed) {
    static body b;
    memset(l, 0, sizeof *l);
    l->seen = rest_of(model, &b);
    l->seen.floor = l->seen.position[HEAD].y - (float)high * standing_height(&l->seen, HEAD);
    l->state.head_speed = vec((float)speed, 0, 0);
    predict_leaning(l, angle);
}

/* By how much the body is turned back in the first frame (rad). */
static double turned_back(const bs_model *model, double angle, double high) {
    static leaning l;
    lean(&l, model, angle, high, 0.0);
    balance_prediction(&l.seen, &l.state, &l.predicted);
    return (double)length(turn_between(turned_by(identity(), vec((float)angle, 0, 0)), l.predicted.rotation[PELVIS]));
}

static double least_lean(const bs_model *m, double sign) { LEAST(-0.05, 0.5, turned_back(m, sign * at, 1.0) > 1e-4); }

/* Half of the leans, from backward to forward, that are left alone. */
static double balance_free(const bs_model *m) { return 0.5 * (least_lean(m, 1.0) + least_lean(m, -1.0)); }

static double balance_low(const bs_model *m) { LEAST(0.2, 2, turned_back(m, 0.3, at) > 1e-3); }

static double balance_stands(const bs_model *m) {
    const double whole = turned_back(m, 0.3, 1.0);
    LEAST(0.2, 2, turned_back(m, 0.3, at) > 0.999 * whole);
}

/* The share of a frame in which a body counts as still. */
static double still_at(const bs_model *model, double speed) {
    static leaning l;
    lean(&l, model, 0.3, 1.0, speed);
    l.state.begun = 1;
    balance_prediction(&l.seen, &l.state, &l.predicted);
    return (double)(l.state.balance.still / TICK);
}

static double balance_still(const bs_model *m) { LEAST(0, 2, still_at(m, at) < 0.99); }
static double balance_moving(const bs_model *m) { LEAST(0, 2, still_at(m, at) < 1e-3); }

/* Seconds in which a lean that is found or given up is half way. `still`: s for which the body has stood. */
static double half_of_lean(const bs_model *model, double still, double speed) {
    static leaning l;
    int frames = 0;
    lean(&l, model, 0.3, 1.0, 0.0);
    balance_prediction(&l.seen, &l.state, &l.predicted);
    const float whole = l.state.balance.lean.z;
    l.state.begun = 1;
    l.state.head_speed = vec((float)speed, 0, 0);
    l.state.balance.still = (float)still;
    if (speed == 0.0) l.state.balance.lean = vec(0, 0, 0);
    do {
        predict_leaning(&l, 0.3);
        balance_prediction(&l.seen, &l.state, &l.predicted);
    } while (++frames < FOREVER && (l.state.balance.lean.z / whole < 0.5F) == (speed == 0.0));
    return (double)frames * (double)TICK;
}

static double balance_first(const bs_model *m) { return half_of_lean(m, 0.0, 0.0); }
static double balance_half_life(const bs_model *m) { return half_of_lean(m, 60.0, 0.0); }
static double balance_fade(const bs_model *m) { return half_of_lean(m, 0.0, 1.0); }

#endif
