/* Numbers of the stance. */
#ifndef BODYSENSE_TUNED_STANCE_H
#define BODYSENSE_TUNED_STANCE_H

#include <string.h>

#include "../src/body/stance.h"
#include "measure.h"
#include "tuned_limbs.h"

/* By how much the legs of a standing body are turned (rad) whose pelvis turns. */
static double legs_turned(const bs_model *model, double turn) {
    static body b;
    static prediction p;
    static pose_state s;
    const tracked t = rest_of(model, &b);
    for (int j = 0; j < BODY_JOINTS; j++) p.rotation[j] = identity();
    p.rotation[PELVIS] = turned_by(identity(), scale(UP, (float)turn));
    memset(&s, 0, sizeof s);
    turn_stance(&t, &s, &p);
    return (double)turn_between(identity(), p.rotation[LEFT_KNEE]).y;
}

static double stance_turned(const bs_model *m) { LEAST(0, 3, legs_turned(m, at) > 1e-4); }

/* Seconds in which half of the turn fades of legs that begin to be measured. */
static double stance_fade(const bs_model *model) {
    static body b;
    static prediction p;
    static pose_state s;
    tracked t = rest_of(model, &b);
    int frames = 0;
    memset(&s, 0, sizeof s);
    s.begun = 1;
    s.stance = 1.0F;
    t.has_rotation[LEFT_KNEE] = true;
    for (int j = 0; j < BODY_JOINTS; j++) p.rotation[j] = identity();
    for (; s.stance > 0.5F && frames < FOREVER; frames++) turn_stance(&t, &s, &p);
    return (double)frames * (double)TICK;
}

#endif
