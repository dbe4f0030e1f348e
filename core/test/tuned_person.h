/* Numbers of proportions, mounts and stature. */
#ifndef BODYSENSE_TUNED_PERSON_H
#define BODYSENSE_TUNED_PERSON_H

#include "../src/person/mounts.h"
#include "../src/person/person.h"
#include "../src/person/shape.h"
#include "measure.h"

/* ---- persons ----------------------------------------------------------------------------------------------------- */

static bool accepts(double height) {
    bs_person person = {.height = height, .height_deviation = 0.01};
    for (int p = 1; p < BS_POINTS; p++) person.rest_offset[p][1] = p == SPINE1 ? 0.5 : -0.1;
    return check_person(&person) == BS_OK;
}

static double person_shortest(const bs_model *m) { (void)m; LEAST(0, 1.5, accepts(at)); }
static double person_tallest(const bs_model *m) { (void)m; LEAST(1.5, 9, !accepts(at)); }

/* Speed (m/s) at which the stature in use nears one that is `more` larger (m), of a wearer who moves. */
static double growth(const bs_model *model, double more, double speed, double known) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    person.height = known;
    proportions_start(&person, &own);
    const double before = rest_height(own.current, HEAD_TOP);
    for (int p = 0; p < BS_POINTS; p++)
        for (int c = 0; c < 3; c++) own.believed[p][c] *= 1 + more / before;
    own.elapsed = 1.0;
    own.speed = speed;
    t.interval = TICK;
    proportions_step(model, &person, &t, (double)TICK, &own);
    return (rest_height(own.current, HEAD_TOP) - before) / (double)TICK;
}

static double growth_still(const bs_model *m) { return growth(m, 1, 0, (double)NAN); }
static double growth_moving(const bs_model *m) { return growth(m, 1, 9, (double)NAN); }
static double growth_moves(const bs_model *m) { LEAST(0, 3, growth(m, 1, at, (double)NAN) > 0.05); }
static double body_half_life(const bs_model *m) { return 0.004 * log(2) / growth(m, 0.004, 0, (double)NAN); }

/* Look at a head that was at `been` and is `ahead` of it (m), `over` its height at rest (m). */
static proportions looked_at(const bs_model *model, double ahead, double over) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.head[0] = own.head[1] = own.head[2] = 0.0;
    own.elapsed = 1.0;
    t.has_position[HEAD] = true;
    t.position[HEAD] = vec((float)ahead, (float)(rest_height(own.believed, HEAD) + over), 0);
    t.accuracy[HEAD] = 0.001F;
    proportions_step(model, &person, &t, 0.1, &own);
    return own;
}

static double walk_ahead(const bs_model *m) { LEAST(0, 3, looked_at(m, at, 0).walked > 0); }
static double walk_farthest(const bs_model *m) { LEAST(3, 20, looked_at(m, at, 0).walked <= 0); }
static double walk_lag(const bs_model *m) { return looked_at(m, 1, 0).been[0]; }
static double height_tiptoe(const bs_model *m) { LEAST(0, 1, looked_at(m, 0, at).contradicting > 0); }

static bool is_released(const bs_model *model, double seconds) {
    proportions own;
    static tracked t;
    bs_person person = {.height = 1.7, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    own = looked_at(model, 0, 0.3);
    own.contradicting = seconds;
    t.has_position[HEAD] = true;
    t.position[HEAD] = vec(0, (float)(rest_height(own.believed, HEAD) + 0.3), 0);
    t.accuracy[HEAD] = 0.001F;
    proportions_step(model, &person, &t, 0.1, &own);
    return own.released;
}

static double height_contradicted(const bs_model *m) { LEAST(0, 10, is_released(m, at)); }

static double mount_half_life(const bs_model *m) {
    static mounts own;
    static tracked t;
    static bs_person person;
    int frames = 0;
    (void)m;
    memset(&own, 0, sizeof own);
    person.mount[LEFT_KNEE].worn = 1;
    own.mean[3] = 0.02;
    do mounts_step(&person, 0.01, &own, &t);
    while (++frames < FOREVER && own.correction[1][0] < 0.01);
    return frames * 0.01;
}

static double mount_interval(const bs_model *m) {
    static mounts own;
    static tracked t;
    static bs_person person;
    int frames = 0;
    (void)m;
    memset(&own, 0, sizeof own);
    person.mount[LEFT_KNEE].worn = 1;
    do mounts_step(&person, 0.001, &own, &t);
    while (++frames < FOREVER && own.due > 0);
    return frames * 0.001;
}

/* ---- lengths ----------------------------------------------------------------------------------------------------- */

/* Look at a thigh of 40 cm for `frames` of `interval` s; its ends err by `accuracy` together (m). */
static proportions measured_thigh(const bs_model *model, int frames, double interval, double accuracy) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.elapsed = 1.0;
    t.has_position[LEFT_HIP] = t.has_position[LEFT_KNEE] = true;
    t.position[LEFT_KNEE] = vec(0, 0.4012F, 0);
    t.accuracy[LEFT_HIP] = t.accuracy[LEFT_KNEE] = 0.5F * (float)accuracy;
    for (int k = 0; k < frames; k++) proportions_step(model, &person, &t, interval, &own);
    return own;
}

static double counted(proportions own) {
    double sum = 0;
    for (int b = 0; b < BINS; b++) sum += (double)own.seconds[4][b];
    return sum;
}

static double length_vague(const bs_model *m) { LEAST(0, 1, counted(measured_thigh(m, 1, 0.2, at)) == 0); }
static double length_interval(const bs_model *m) { LEAST(0, 1, counted(measured_thigh(m, 1, at, 0.01)) > 0); }
static double body_interval(const bs_model *m) { LEAST(0.11, 2, measured_thigh(m, 1, at, 0.01).due == 0); }

static double length_bin(const bs_model *m) {
    const proportions own = measured_thigh(m, 1, 0.2, 0.01);
    int bin = 0;
    while (bin < BINS - 1 && own.seconds[4][bin] == 0) bin++;
    return 0.4012 / (bin + 0.5);
}

/* ---- more mounts ------------------------------------------------------------------------------------------------- */

/* The mounts after a leg was `excess` (m) longer than its bones: between pelvis and knee, or ankle. `unsure` are the
 * variances (m²) of a bone and of the pelvis's place. */
static mounts strapped(double excess, bool ankle, double unsure_bone, double unsure_place) {
    static mounts own;
    static tracked t;
    static bs_person person;
    const int end = ankle ? LEFT_ANKLE : LEFT_KNEE;
    memset(&own, 0, sizeof own);
    memset(&t, 0, sizeof t);
    memset(&person, 0, sizeof person);
    person.mount[PELVIS].worn = person.mount[end].worn = 1;
    for (int k = 0; k < LIMB_BONES; k++) {
        own.mean[3 * REFINED_JOINTS + k] = 0.4;
        own.covariance[3 * REFINED_JOINTS + k][3 * REFINED_JOINTS + k] = unsure_bone;
    }
    own.covariance[1][1] = unsure_place;
    t.has_position[PELVIS] = t.has_rotation[PELVIS] = t.has_position[end] = t.has_rotation[end] = true;
    t.rotation[PELVIS] = t.rotation[end] = identity();
    t.position[end] = vec(0, -(float)((ankle ? 0.8 : 0.4) + excess), 0);
    mounts_step(&person, 0.2, &own, &t);
    return own;
}

static double thigh_change(mounts own) { return fabs(own.mean[3 * REFINED_JOINTS] - 0.4); }
static double mount_farthest(const bs_model *m) {
    (void)m;
    LEAST(0, 1, thigh_change(strapped(at, false, 1e-8, 0)) == 0);
}
static double mount_most(const bs_model *m) { (void)m; LEAST(0, 1, strapped(at, false, 0, 1).mean[1] == 0); }
static double mount_bent(const bs_model *m) { (void)m; LEAST(0, 1, thigh_change(strapped(-at, true, 1e-8, 0)) == 0); }

static double mount_short_noise(const bs_model *m) {
    (void)m;
    return sqrt(1e-6 * 0.005 / thigh_change(strapped(-0.005, true, 1e-6, 0)));
}

static double mount_slip(const bs_model *m) {
    (void)m;
    return sqrt(strapped(9, false, 1e-12, 0).covariance[3 * REFINED_JOINTS][3 * REFINED_JOINTS] / 0.2);
}

static double mount_bone_least(const bs_model *m) {
    static mounts own;
    static bs_person person;
    (void)m;
    mounts_start(&person, &own);
    return sqrt(own.covariance[3 * REFINED_JOINTS][3 * REFINED_JOINTS]);
}

/* ---- stature from the head --------------------------------------------------------------------------------------- */

#define OVER_FLOOR (EVIDENCE - 1)

/* Seconds for which a head was at a height (m). */
typedef struct spell {
    double height, seconds;
} spell;

/* Proportions after a head was at one height or two, of a wearer of an unknown body who walked for some seconds. */
static proportions inferred(const bs_model *model, spell first, spell second, double walked, double tallest) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.elapsed = 1.0;
    own.walked = walked;
    own.tallest = tallest;
    own.seated = tallest > 0;
    own.seconds[OVER_FLOOR][(int)(first.height * 200)] += (float)first.seconds;
    own.seconds[OVER_FLOOR][(int)(second.height * 200)] += (float)second.seconds;
    proportions_step(model, &person, &t, 0.6, &own);
    return own;
}

static proportions after(const bs_model *model, double height, double walked) {
    return inferred(model, (spell){height, 100}, (spell){height, 0}, walked, 0);
}

static double stature_after(const bs_model *model, double height) {
    proportions own = after(model, height, 0);
    return rest_height(own.believed, HEAD_TOP);
}

static double head_after(proportions own) { return rest_height(own.believed, HEAD); }

static double standing_stoop(const bs_model *m) { return head_after(after(m, 1.601, 0)) - 1.6025; }
static double seated_slope(const bs_model *m) { return (stature_after(m, 1.251) - stature_after(m, 1.151)) / 0.1; }
static double seated_head(const bs_model *m) { return stature_after(m, 1.201) - 1.5; }
static double seated_noise(const bs_model *m) { return 1 - 0.7 * seated_slope(m); }

static double standing_noise(const bs_model *m) {
    return 1 - (head_after(after(m, 1.801, 0)) - head_after(after(m, 1.501, 0))) / 0.3;
}

static double stands_from(const bs_model *model, double walked) { LEAST(1.15, 1.7, !after(model, at, walked).seated); }
static double sits_from(const bs_model *model) { LEAST(0.7, 1.2, fabs(stature_after(model, at) - 1.694) > 1e-4); }
static double high_from(const bs_model *model) { LEAST(1.7, 2.39, after(model, at, 0).seated); }
static double stature_deviation(const bs_model *m) { return 1.2 - sits_from(m); }
static double walk_seconds(const bs_model *m) { return stands_from(m, 0) - stands_from(m, 1); }
static double high_head(const bs_model *m) { return high_from(m) - 1.5; }
static double low_head(const bs_model *m) { return stature_after(m, 1.851) + stature_after(m, 0.901) - 3; }

static double upright_seconds(const bs_model *m) {
    LEAST(0, 20, head_after(inferred(m, (spell){1.501, 100}, (spell){1.751, at}, 0, 0)) > 1.6);
}

static double walking_bob(const bs_model *m) {
    LEAST(0, 0.3, head_after(inferred(m, (spell){1.501, 100}, (spell){1.501 + at, 10}, 0, 0)) > 1.531 + 0.5 * at);
}

static double seat_mistaken(const bs_model *model) {
    proportions own = after(model, 1.601, 1);
    const double stands = rest_height(own.believed, HEAD_TOP);
    LEAST(0.01, 1, !inferred(model, (spell){1.601, 100}, (spell){1.601, 0}, 1, stands + at).seated);
}

static double shrink_most(const bs_model *model) {
    proportions own = inferred(model, (spell){1.601, 100}, (spell){1.601, 0}, 0, 1.9);
    return 1.9 - rest_height(own.believed, HEAD_TOP);
}

static bool grows_only(const bs_model *model, double elapsed) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.elapsed = elapsed;
    proportions_step(model, &person, &t, (double)TICK, &own);
    return own.tallest > 0;
}

static double shrink_seconds(const bs_model *m) { LEAST(0.01, 20, grows_only(m, at)); }

/* Whether a body with such a deviation of a leg (m) starts as the first frame suggests. */
static bool starts_anew(const bs_model *model, double deviation) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    for (int p = LEFT_ANKLE; p != PELVIS; p = PARENT[p]) person.deviation[p] = deviation / 3;
    proportions_start(&person, &own);
    t.has_position[HEAD] = true;
    t.position[HEAD] = vec(0, 1.75F, 0);
    t.accuracy[HEAD] = 0.001F;
    const double before = rest_height(own.current, HEAD);
    proportions_step(model, &person, &t, (double)TICK, &own);
    return rest_height(own.current, HEAD) > before + 0.05;
}

static double unknown_leg(const bs_model *m) { LEAST(0.001, 1, starts_anew(m, at)); }

/* The distance of two points of the believed body (m) after it was measured at three lengths, for shares of time. */
static double believed_length(const bs_model *model, int row, int start, int end, const spell seen[3]) {
    static proportions own;
    static tracked t;
    bs_person person = {.height = (double)NAN, .height_deviation = 0.01};
    double apart = 0.0;
    if (bs_person_likeliest(model, &person) != BS_OK) exit(1);
    proportions_start(&person, &own);
    own.elapsed = 1.0;
    for (int k = 0; k < 3; k++) own.seconds[row][(int)(seen[k].height * 200)] += (float)seen[k].seconds;
    proportions_step(model, &person, &t, 0.6, &own);
    for (int c = 0; c < 3; c++) {
        double between = 0.0;
        for (int p = end; p != start; p = PARENT[p]) between += own.believed[p][c];
        apart += between * between;
    }
    return sqrt(apart);
}

static double length_sure(const bs_model *m) {
    const spell seen[3] = {{0.361, 30}, {0.401, 40}, {0.441, 30}};
    return believed_length(m, 4, LEFT_HIP, LEFT_KNEE, seen) - 0.35;
}

static double length_leg(const bs_model *m) {
    const spell seen[3] = {{0.751, 60}, {0.851, 36}, {0.901, 4}};
    return believed_length(m, 12, LEFT_HIP, LEFT_ANKLE, seen) - 0.75;
}

static double length_arm(const bs_model *m) {
    const spell seen[3] = {{0.451, 60}, {0.551, 39}, {0.601, 1}};
    return believed_length(m, 14, LEFT_SHOULDER, LEFT_WRIST, seen) - 0.45;
}

#endif
