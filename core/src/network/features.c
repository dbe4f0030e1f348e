/* Features: tracked points of a body in the frame under the head, scaled to one stature: the network's input. */
#include "features.h"

#include <string.h>

#include "../constants.h"
#include "tracked.h"

#define LEAST_TURN 1e-6F       /* of a head that is upside down, which has no heading of its own */
#define FLATTEST 1e-6F         /* of that: no body is lower */

static const signed char SPINNING_JOINT[SPINNING] = {HEAD, LEFT_WRIST, RIGHT_WRIST};
static const signed char STRAPPED[STRAPPED_JOINTS] = {PELVIS,        SPINE3,         LEFT_HIP,   RIGHT_HIP,
                                                      LEFT_KNEE,     RIGHT_KNEE,     LEFT_ANKLE, RIGHT_ANKLE,
                                                      LEFT_SHOULDER, RIGHT_SHOULDER, LEFT_ELBOW, RIGHT_ELBOW};

static bool turned(const tracked *seen, int joint) { return seen->has_rotation[joint] || seen->implied[joint]; }

head_frame find_frame(const tracked *seen, const input_memory *last) {
    static const signed char PAIR[3][2] = {
        {LEFT_HIP, RIGHT_HIP}, {LEFT_SHOULDER, RIGHT_SHOULDER}, {LEFT_ANKLE, RIGHT_ANKLE}};
    float cosine = last->cosine, sine = last->sine;
    vec3 line = vec(0, 0, 0); /* from right to left */
    for (int k = 0; k < 3; k++) {
        const int left = PAIR[k][0], right = PAIR[k][1];
        if (seen->has_position[left] && seen->has_position[right])
            line = add(line, sub(seen->position[left], seen->position[right]));
    }
    if (line.x * line.x + line.z * line.z > SHORTEST_LINE * SHORTEST_LINE) cosine = line.x, sine = -line.z;
    for (int k = 0; k < 2; k++) { /* the twist of a rotation about +Y, which is steady when it looks up or down */
        const int joint = k ? HEAD : PELVIS;
        if (!turned(seen, joint)) continue;
        const mat3 *m = &seen->rotation[joint];
        cosine = m->x.x + m->z.z, sine = m->z.x - m->x.z;
    }
    cosine += LEAST_TURN * last->cosine, sine += LEAST_TURN * last->sine;
    const float size = sqrtf(cosine * cosine + sine * sine);
    const vec3 head = seen->position[HEAD];
    const head_frame frame = {vec(head.x, seen->floor, head.z), cosine / size, sine / size};
    const head_frame unturned = {frame.origin, last->cosine, last->sine};
    return size > 1e-12F ? frame : unturned;
}

float stature(const vec3 rest_offset[BS_POINTS]) {
    float height[BODY_JOINTS], lowest = 0; /* m, above the pelvis */
    height[0] = 0;
    for (int k = 1; k < BODY_POINTS; k++) {
        const int point = BODY_POINT[k];
        const float here = height[PARENT[point]] + rest_offset[point].y;
        if (point < BODY_JOINTS) height[point] = here;
        lowest = here < lowest ? here : lowest;
    }
    return (height[HEAD] - lowest) / REFERENCE_HEAD + FLATTEST;
}

/* Whether a point's position follows from the measured pose of its parent, and tells nothing of other joints: of hips,
 * spine, shoulders and feet. Few sequences of training have such points. Many have head tops and knuckles, which cameras
 * see. */
static bool follows(const tracked *seen, int point) {
    switch (point) {
    case PELVIS: case HEAD: case HEAD_TOP: case LEFT_KNEE: case RIGHT_KNEE: case LEFT_ANKLE: case RIGHT_ANKLE:
    case LEFT_ELBOW: case RIGHT_ELBOW: case LEFT_WRIST: case RIGHT_WRIST: return false;
    default: break;
    }
    if (point < BODY_JOINTS && turned(seen, point)) return false;
    return seen->has_position[PARENT[point]] && seen->has_rotation[PARENT[point]];
}

reading read_person(const tracked *seen, const input_memory *last) {
    reading read;
    read.size = stature(seen->rest_offset);
    read.interval = last->elapsed + seen->interval;
    for (int k = 0; k < BODY_POINTS; k++) {
        read.place[k] = seen->position[BODY_POINT[k]];
        read.has_place[k] = seen->has_position[BODY_POINT[k]] && !follows(seen, BODY_POINT[k]);
    }
    for (int hand = 0; hand < 2; hand++) {
        vec3 sum = vec(0, 0, 0);
        for (int k = 0; k < KNUCKLES; k++) sum = add(sum, seen->knuckle[hand][k]);
        read.place[BODY_POINTS + hand] = scale(sum, 0.25F);
        read.has_place[BODY_POINTS + hand] = seen->has_knuckles[hand];
    }
    for (int joint = 0; joint < BODY_JOINTS; joint++) read.has_axes[joint] = turned(seen, joint);
    return read;
}

/* The knuckle whose accuracy is that of the middle of a hand's: the first one that is measured. */
static int accurate_knuckle(const tracked *seen, int hand) {
    return seen->has_position[KNUCKLE[hand][0]] ? KNUCKLE[hand][0] : KNUCKLE[hand][1];
}

static int partner_read(int k) {
    if (k >= BODY_POINTS) return 2 * BODY_POINTS + 1 - k;
    const int partner = PARTNER[BODY_POINT[k]];
    for (int other = 0; other < BODY_POINTS; other++) {
        if (BODY_POINT[other] == partner) return other;
    }
    return k;
}

void write_features(const bs_model *model, const tracked *seen, const reading *read, head_frame frame,
                    const input_memory *last, bool mirrored, float *out) {
    const float smaller = 1.0F / read->size, rate = 1.0F / read->interval;
    const vec3 none = vec(0, 0, 0);
    float *first = out;
    int source[READ_POINTS];
    for (int k = 0; k < READ_POINTS; k++) source[k] = mirrored ? partner_read(k) : k;

    for (int k = 0; k < READ_POINTS; k++) {
        const vec3 v = scale(to_frame(frame, sub(read->place[source[k]], frame.origin)), smaller);
        out = put(out, !read->has_place[source[k]] ? none : mirrored ? reflected(v) : v);
    }
    for (int k = 0; k < READ_POINTS; k++) *out++ = read->has_place[source[k]] ? 1.0F : 0.0F;
    for (int k = 0; k < READ_POINTS; k++) {
        const int s = source[k];
        const vec3 displacement = sub(read->place[s], last->place[s]);
        const vec3 v = clamped(scale(to_frame(frame, displacement), smaller * rate), FEATURE_FASTEST);
        out = put(out, !read->has_place[s] || last->had_place[s] < 0.5F ? none : mirrored ? reflected(v) : v);
    }
    for (int k = 0; k < READ_POINTS; k++) {
        const int s = source[k], point = s < BODY_POINTS ? BODY_POINT[s] : accurate_knuckle(seen, s - BODY_POINTS);
        const float accuracy = seen->accuracy[point] > FEATURE_FINEST ? seen->accuracy[point] : FEATURE_FINEST;
        *out++ = read->has_place[s] ? (logarithm(accuracy) + 6.90775528F) * 0.434294482F : 0.0F; /* log10 of mm */
    }
    for (int joint = 0; joint < BODY_JOINTS; joint++) {
        const int s = mirrored ? PARTNER[joint] : joint;
        const vec3 x = to_frame(frame, seen->rotation[s].x), y = to_frame(frame, seen->rotation[s].y);
        if (!read->has_axes[s]) out = put_axes(out, none, none);
        else out = mirrored ? put_axes(out, scale(reflected(x), -1), reflected(y)) : put_axes(out, x, y);
    }
    for (int joint = 0; joint < BODY_JOINTS; joint++)
        *out++ = read->has_axes[mirrored ? PARTNER[joint] : joint] ? 1.0F : 0.0F;
    for (int k = 0; k < SPINNING; k++) {
        const int s = mirrored && k ? SPINNING - k : k, joint = SPINNING_JOINT[s];
        const vec3 dx = sub(seen->rotation[joint].x, last->axis[s][0]);
        const vec3 dy = sub(seen->rotation[joint].y, last->axis[s][1]);
        const vec3 x = clamped(scale(to_frame(frame, dx), rate), FEATURE_SWIFTEST);
        const vec3 y = clamped(scale(to_frame(frame, dy), rate), FEATURE_SWIFTEST);
        if (!read->has_axes[joint] || last->had_axes[s] < 0.5F) out = put_axes(out, none, none);
        else out = mirrored ? put_axes(out, scale(reflected(x), -1), reflected(y)) : put_axes(out, x, y);
    }
    for (int k = 0; k < BODY_POINTS; k++) {
        const int s = source[k];
        const float *usual = model->usual_bones + (size_t)(3 * s);
        const vec3 bone = sub(scale(seen->rest_offset[BODY_POINT[s]], smaller), vec(usual[0], usual[1], usual[2]));
        const vec3 v = scale(bone, s ? FEATURE_BONE_SCALE : 0.0F); /* the pelvis hangs on nothing */
        out = put(out, mirrored ? reflected(v) : v);
    }
    for (int k = 0; k < BODY_POINTS; k++) *out++ = FEATURE_BONE_SCALE * seen->deviation[BODY_POINT[source[k]]];
    *out++ = USUAL_RATE * read->interval;
    if (model->features >= FEATURES_ACCELERATION) {
        for (int k = 0; k < STRAPPED_JOINTS; k++) {
            const int joint = mirrored ? PARTNER[STRAPPED[k]] : STRAPPED[k];
            const vec3 felt = clamped(scale(to_frame(frame, seen->acceleration[joint]), smaller), FEATURE_STRONGEST);
            const vec3 v = scale(felt, FEATURE_ACCELERATION_SCALE);
            out = put(out, !seen->has_acceleration[joint] ? none : mirrored ? reflected(v) : v);
        }
        for (int k = 0; k < STRAPPED_JOINTS; k++)
            *out++ = seen->has_acceleration[mirrored ? PARTNER[STRAPPED[k]] : STRAPPED[k]] ? 1.0F : 0.0F;
    }
    for (float *at = first; at < out; at++) *at = clamp(*at, -FEATURE_REACH, FEATURE_REACH);
}
