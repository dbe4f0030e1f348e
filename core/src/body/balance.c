/* Balance: see balance.h. */
#include "balance.h"

#include <string.h>

#include "../base/kinematics.h"
#include "../base/maths.h"
#include "../constants.h"
#include "trunk.h"

/* Segments of the body with their shares of its mass (Winter, Biomechanics and Motor Control of Human Movement, 2009,
 * Table 4.1; a forearm with its hand). */
static const struct {
    signed char start, end;
    float mass;
} SEGMENT[] = {
    {HEAD, HEAD, 0.081F},
    {NECK, PELVIS, 0.497F},
    {LEFT_SHOULDER, LEFT_ELBOW, 0.028F},
    {RIGHT_SHOULDER, RIGHT_ELBOW, 0.028F},
    {LEFT_ELBOW, LEFT_WRIST, 0.022F},
    {RIGHT_ELBOW, RIGHT_WRIST, 0.022F},
    {LEFT_HIP, LEFT_KNEE, 0.1F},
    {RIGHT_HIP, RIGHT_KNEE, 0.1F},
    {LEFT_KNEE, LEFT_ANKLE, 0.0465F},
    {RIGHT_KNEE, RIGHT_ANKLE, 0.0465F},
    {LEFT_ANKLE, LEFT_FOOT, 0.0145F},
    {RIGHT_ANKLE, RIGHT_FOOT, 0.0145F},
};

/* Ends of the chains of joints that are turned. */
static const signed char END[] = {HEAD, LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ANKLE, RIGHT_ANKLE};

/* Whether a point hangs on a joint, at any depth; parents come before their children. */
static bool hangs_on(int point, int joint) {
    do point = PARENT[point];
    while (point > joint);
    return point == joint;
}

/* Whether the head is placed, and the legs and the trunk up to the neck and the collars are predicted. */
static bool predicted_below(const tracked *t) {
    for (int k = 0; k < BODY_POINTS; k++) {
        if (!hangs_on(BODY_POINT[k], SPINE3) && is_measured(t, BODY_POINT[k])) return false;
    }
    return t->has_position[HEAD];
}

static vec3 centre_of_mass(const body *b) {
    vec3 sum = vec(0, 0, 0);
    float mass = 0.0F;
    for (size_t k = 0; k < sizeof SEGMENT / sizeof *SEGMENT; k++) {
        vec3 centre = mix(b->point[SEGMENT[k].start], b->point[SEGMENT[k].end], BALANCE_CENTRE);
        sum = along(sum, centre, SEGMENT[k].mass);
        mass += SEGMENT[k].mass;
    }
    return scale(sum, 1.0F / mass);
}

/* The middle of the feet, of those that stand above all. */
static vec3 support(const body *b, const prediction *p) {
    vec3 sum = vec(0, 0, 0);
    float weight = 0.0F;
    for (int k = 0; k < 2; k++) {
        float stands = fmaxf(p->contact[k], p->contact[2 + k]) + BALANCE_IN_AIR;
        sum = along(sum, mix(b->point[LEFT_ANKLE + k], b->point[LEFT_FOOT + k], 0.5F), stands);
        weight += stands;
    }
    return scale(sum, 1.0F / weight);
}

static float between(float x, float from, float to) { return clamp((x - from) / (to - from), 0.0F, 1.0F); }

/* Average the lean of a body that stands still: over as long as it has, up to BALANCE_HALF_LIFE. */
static void average_lean(vec3 lean, float still, float interval, balance_state *s) {
    s->still = (s->still + interval * still) * power_of_two(-(1.0F - still) * interval / BALANCE_FIRST);
    float half_life = clamp(s->still, BALANCE_FIRST, BALANCE_HALF_LIFE);
    float share = still * (1.0F - power_of_two(-interval / half_life));
    s->lean = scale(mix(s->lean, lean, share), power_of_two(-(1.0F - still) * interval / BALANCE_FADE));
}

void balance_prediction(const tracked *t, pose_state *s, prediction *p) {
    balance_state *own = &s->balance;
    float stands = 0.0F, cosine, sine;
    heading_of(p->rotation[PELVIS], &cosine, &sine);
    if (predicted_below(t)) {
        body b;
        memcpy(b.rotation, p->rotation, sizeof p->rotation);
        place(&b, t, t->position[HEAD]);
        vec3 off = sub(centre_of_mass(&b), support(&b, p));
        if (off.y > BALANCE_OVER) {
            float speed = length(vec(s->head_speed.x, 0, s->head_speed.z));
            stands = between((t->position[HEAD].y - t->floor) / standing_height(t, HEAD), BALANCE_LOW, BALANCE_STANDS);
            float still = stands * between(speed, BALANCE_MOVING, BALANCE_STILL);
            vec3 lean = into_heading(scale(vec(off.x, 0, off.z), 1.0F / off.y), cosine, sine);
            if (s->begun) average_lean(lean, still, t->interval, own);
            else *own = (balance_state){lean, stands, 0.0F, 0.0F};
            own->free = BALANCE_FREE / off.y;
        }
    }
    own->stands += (stands - own->stands) * (1.0F - power_of_two(-t->interval / BALANCE_FIRST));
    vec3 lean = from_heading(own->lean, cosine, sine);
    float far = length(lean);
    if (far <= own->free || own->stands == 0.0F) return;
    vec3 turn = scale(vec(-lean.z, 0.0F, lean.x), own->stands * (far - own->free) / far);
    bool turned[BODY_JOINTS] = {false};
    for (size_t k = 0; k < sizeof END / sizeof *END; k++)
        for (int j = PARENT[END[k]]; j >= 0 && !turned[j]; j = PARENT[j]) {
            p->rotation[j] = turned_by(p->rotation[j], turn);
            turned[j] = true;
        }
}
