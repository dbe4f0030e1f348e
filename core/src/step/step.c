/* The step: frames of some people in, whole bodies out. */
#include <string.h>

#include "../base/quaternion.h"
#include "../body/head.h"
#include "../constants.h"
#include "../network/model.h"
#include "../network/network.h"
#include "clock.h"
#include "pose.h"
#include "state.h"

/* Arrays of one frame of some people, in scratch. */
typedef struct frames {
    tracked *seen;
    prediction *predicted;
    head_frame *head;
    head_reading *measured;
    body *body;
    float (*finger_error)[2 * HAND_POINTS];
    float **memory;
    double *interval;
    bool *fresh;
    void *network;
} frames;

bs_settings bs_default_settings(void) {
    return (bs_settings){.floor = 0, .ease = 0.25, .longest_gap = 1, .first = 1.0 / 30, .longest = 0.1, .hold_feet = 1,
                         .infer = 1};
}

static bool possible(const bs_settings *own) {
    return fabs(own->floor) < INPUT_FARTHEST && own->ease >= 0 && own->ease <= SETTING_LONGEST_EASE &&
           own->longest_gap > 0 && own->first >= SETTING_SHORTEST_INTERVAL && own->first <= SETTING_LONGEST_INTERVAL &&
           own->longest >= SETTING_SHORTEST_INTERVAL && own->longest <= SETTING_LONGEST_INTERVAL;
}

/* Lay the arrays of a frame out in scratch, if there is any. Returns the bytes that they need. */
static size_t lay_out(const bs_model *model, int people, void *scratch, frames *all) {
    size_t count = (size_t)people, at = 0;
    char *memory = scratch;
#define TAKE(member)                                         \
    if (memory) all->member = (void *)(memory + at); \
    at += aligned(count * sizeof *all->member)
    TAKE(seen);
    TAKE(predicted);
    TAKE(head);
    TAKE(measured);
    TAKE(body);
    TAKE(finger_error);
    TAKE(memory);
    TAKE(interval);
    TAKE(fresh);
#undef TAKE
    if (memory) all->network = memory + at;
    return at + aligned(network_scratch(model, people));
}

size_t bs_scratch_size(const bs_model *model, int people) {
    if (people < 1 || people > BS_MOST_PEOPLE) return 0;
    return lay_out(model, people, NULL, &(frames){0});
}

/* Whether n numbers are finite and at most so large. */
static bool within(const double *value, int n, double most) {
    for (int i = 0; i < n; ++i)
        if (!(fabs(value[i]) <= most)) return false;
    return true;
}

/* Whether the tracked points of frame t are plausible. */
static bs_result check_frame(const bs_observation *observation, int t) {
    for (int p = 0; p < observation->points; ++p) {
        size_t i = (size_t)t * (size_t)observation->points + (size_t)p;
        const double *position = observation->position + 3 * i, *q = observation->rotation + 4 * i;
        if (observation->point[p] < 0 || observation->point[p] >= BS_POINTS) return BS_POINT_UNKNOWN;
        if (observation->has_position[i]) {
            double accuracy = observation->accuracy[i];
            if (!within(position, 3, INPUT_FARTHEST) || !(accuracy > 0 && isfinite(accuracy))) return BS_VALUE_NOT_FINITE;
        }
        if (observation->has_rotation[i] &&
            !(fabs(sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1.0) < INPUT_UNIT))
            return BS_VALUE_NOT_FINITE;
    }
    return BS_OK;
}

/* Whole metres near the head, or else near the first point that is tracked, at the height of the floor. */
static void choose_base(const bs_observation *observation, int t, double floor, double base[3]) {
    base[0] = base[2] = 0.0;
    base[1] = rint(floor);
    bool found = false;
    for (int p = 0; p < observation->points; ++p) {
        size_t i = (size_t)t * (size_t)observation->points + (size_t)p;
        if (!observation->has_position[i] || (found && observation->point[p] != HEAD)) continue;
        base[0] = rint(observation->position[3 * i]);
        base[2] = rint(observation->position[3 * i + 2]);
        found = true;
    }
}

/* Gather the tracked points of frame t. */
static void gather(const bs_observation *observation, int t, const bs_state *state, tracked *seen) {
    memset(seen, 0, sizeof *seen);
    memcpy(seen->base, state->base, sizeof seen->base);
    for (int p = 0; p < BS_POINTS; ++p) seen->accuracy[p] = UNTRACKED;
    for (int j = 0; j < BS_JOINTS; ++j) seen->rotation[j] = identity();
    for (int p = 0; p < observation->points; ++p) {
        size_t i = (size_t)t * (size_t)observation->points + (size_t)p;
        int point = observation->point[p];
        const double *position = observation->position + 3 * i;
        if (observation->has_position[i]) {
            seen->has_position[point] = true;
            seen->position[point] = vec((float)(position[0] - seen->base[0]), (float)(position[1] - seen->base[1]),
                                        (float)(position[2] - seen->base[2]));
            seen->accuracy[point] = (float)fmin(fmax(observation->accuracy[i], INPUT_FINEST), INPUT_COARSEST);
        }
        if (observation->has_rotation[i] && point < BS_JOINTS) {
            seen->has_rotation[point] = true;
            seen->rotation[point] = matrix_of(observation->rotation + 4 * i);
        }
        if (observation->acceleration && point < BODY_JOINTS) {
            const double *a = observation->acceleration + 3 * i;
            seen->has_acceleration[point] = within(a, 3, INPUT_FARTHEST);
            if (seen->has_acceleration[point])
                seen->acceleration[point] = vec((float)a[0], (float)a[1], (float)a[2]);
        }
    }
}

/* Everything of a frame that comes before the network. */
static void prepare(const bs_model *model, const bs_settings *settings, const bs_observation *observation, int t,
                    double interval, bool fresh, bs_state *state, tracked *seen) {
    if (fresh) { /* after a gap forget the motion, but keep the person */
        choose_base(observation, t, settings->floor, state->base);
        network_start(model, state_memory(state));
        pose_start(&state->pose);
    }
    state->time = observation->time[t];
    gather(observation, t, state, seen);
    seen->interval = (float)interval;
    seen->floor = (float)(settings->floor - state->base[1]);
    mounts_apply(&state->person, seen);
    if (settings->infer) {
        mounts_step(&state->person, interval, &state->mounts, seen);
        proportions_step(model, &state->person, seen, interval, &state->proportions);
    }
    const proportions *own = &state->proportions;
    for (int p = 0; p < BS_POINTS; ++p) {
        seen->rest_offset[p] = vec((float)own->current[p][0], (float)own->current[p][1], (float)own->current[p][2]);
        seen->deviation[p] = (float)own->deviation[p];
    }
    pose_read(settings, &state->pose, seen);
}

/* Write what was completed as frame t. */
static void write(const bs_estimate *estimate, int t, const tracked *seen, const body *body, const prediction *predicted,
                  const float confidence[BS_POINTS], const float bound[BS_POINTS], const proportions *own) {
    size_t row = (size_t)t * BS_POINTS;
    for (int p = 0; p < BS_POINTS; ++p) {
        vec3 at = body->point[p];
        double place[3] = {seen->base[0] + (double)at.x, seen->base[1] + (double)at.y, seen->base[2] + (double)at.z};
        size_t i = row + (size_t)p;
        if (estimate->points) memcpy(estimate->points + 3 * i, place, sizeof place);
        if (estimate->root_position && p == PELVIS) memcpy(estimate->root_position + 3 * t, place, sizeof place);
        if (estimate->measured) estimate->measured[i] = seen->has_position[p];
        if (estimate->confidence) estimate->confidence[i] = (double)confidence[p];
        if (estimate->bound) estimate->bound[i] = (double)bound[p];
        if (estimate->rest_offset) memcpy(estimate->rest_offset + 3 * i, own->current[p], sizeof own->current[p]);
    }
    for (int j = 0; j < BS_JOINTS && estimate->rotation; ++j) {
        mat3 local = j == PELVIS ? body->rotation[j] : product(transpose(body->rotation[PARENT[j]]), body->rotation[j]);
        quaternion_of(local, estimate->rotation + 4 * ((size_t)t * BS_JOINTS + (size_t)j));
    }
    for (int c = 0; c < BS_CONTACTS && estimate->contact; ++c)
        estimate->contact[t * BS_CONTACTS + c] = (double)predicted->contact[c];
}

bs_result bs_step(const bs_model *model, const bs_settings *settings, int people, const bs_observation *observation,
                  bs_state *const *state, const bs_estimate *estimate, void *scratch, size_t scratch_size,
                  int *refused) {
    frames all = {0};
    int ignored;
    if (!refused) refused = &ignored;
    *refused = 0;
    if (people < 1 || people > BS_MOST_PEOPLE) return BS_COUNT_IMPOSSIBLE;
    if (!possible(settings)) return BS_SETTING_IMPOSSIBLE;
    if (scratch_size < bs_scratch_size(model, people) || !is_aligned(scratch)) return BS_MEMORY_SMALL;
    int frame_count = observation[0].frames;
    for (int k = 0; k < people; ++k) {
        *refused = k;
        if (observation[k].frames < 1 || observation[k].frames != frame_count || observation[k].points < 0)
            return BS_COUNT_IMPOSSIBLE;
        if (state[k]->model != model_fingerprint(model)) return BS_STATE_FOREIGN;
    }
    lay_out(model, people, scratch, &all);
    for (int k = 0; k < people; ++k) all.memory[k] = state_memory(state[k]);
    for (int t = 0; t < frame_count; ++t) {
        for (int k = 0; k < people; ++k) {
            *refused = k;
            bs_result result = clock_interval(settings, observation[k].time[t], state[k]->time, &all.interval[k],
                                              &all.fresh[k]);
            if (result == BS_OK) result = check_frame(&observation[k], t);
            if (result != BS_OK) return result;
        }
        for (int k = 0; k < people; ++k)
            prepare(model, settings, &observation[k], t, all.interval[k], all.fresh[k], state[k], &all.seen[k]);
        for (int k = 0; k < people; ++k) all.measured[k] = readable_head(model, &state[k]->pose, &all.seen[k]);
        predict_bodies(model, people, all.seen, all.head, all.memory, all.predicted, all.network);
        for (int k = 0; k < people; ++k) {
            measured_head(all.measured[k], &all.seen[k]);
            pose_body(settings, &all.seen[k], &all.predicted[k], &state[k]->pose, &all.body[k]);
        }
        complete_fingers(model, people, all.seen, all.head, all.body, all.memory, all.finger_error, all.network);
        for (int k = 0; k < people; ++k) {
            float off[BS_POINTS], confidence[BS_POINTS], bound[BS_POINTS];
            pose_finish(&all.seen[k], &state[k]->pose, &all.body[k], off);
            expected_errors(model, &all.seen[k], &all.predicted[k], all.finger_error[k], off, confidence, bound);
            write(&estimate[k], t, &all.seen[k], &all.body[k], &all.predicted[k], confidence, bound,
                  &state[k]->proportions);
        }
    }
    *refused = 0;
    return BS_OK;
}
