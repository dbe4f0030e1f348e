/* Tests of the core on a tiny random model: properties of bodies over random observations, and the hash of a run.
 *
 *     test [FILTER]      run the tests whose name contains FILTER
 *     test --golden      print the hash of the golden run
 *     test --write FILE  write the tiny model, for other programs
 *
 * GOLDEN (golden.h) is the hash of all output bytes of a run. It is equal for every kernel, thread, compiler and for
 * WebAssembly: sums are of whole numbers or in one order, nothing is contracted, and maths.h has its own functions.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/base/kinematics.h"
#include "../src/base/targets.h"
#include "golden.h"
#include "random_model.h"
#include "tuned.h"

#define FRAMES 60
#define DRAWS 60
#define PEOPLE 3
#define MODEL_SEED 7
#define MET 0.002   /* m; a wrist that bones can reach is as near to its measured place */
#define SINK 0.0005 /* m; the last correction of a foot turns it a little */
#define TUNED_BAND 0.2 /* a number that is halved or doubled changes its measure by more */
#define HINGE 0.02  /* of the length of a shin; a straight leg may bend backward by a degree */

static int failures, failures_before; /* before this test */

/* Count a failure, and print the first few of a test. */
static void expect(bool holds, const char *what, int draw, int frame, double value) {
    if (holds) return;
    if (failures++ - failures_before < 8) fprintf(stderr, "  %s: draw %d, frame %d: %g\n", what, draw, frame, value);
}

static void *memory_of(size_t bytes) {
    void *memory = aligned_alloc(64, (bytes + 63) / 64 * 64);
    if (!memory) exit(1);
    return memory;
}

/* ---- observations ------------------------------------------------------------------------------------------------ */

/* A moving body and the points of it that are tracked. */
typedef struct scene {
    bs_person person;
    bs_settings settings;
    int points;
    int32_t point[BS_POINTS];
    double time[FRAMES];
    double position[FRAMES][BS_POINTS][3], rotation[FRAMES][BS_POINTS][4], accuracy[FRAMES][BS_POINTS];
    uint8_t has_position[FRAMES][BS_POINTS], has_rotation[FRAMES][BS_POINTS];
} scene;

typedef struct result {
    double root[FRAMES][3], rotation[FRAMES][BS_JOINTS][4], points[FRAMES][BS_POINTS][3];
    uint8_t measured[FRAMES][BS_POINTS];
    double confidence[FRAMES][BS_POINTS], bound[FRAMES][BS_POINTS], contact[FRAMES][BS_CONTACTS];
    double rest_offset[FRAMES][BS_POINTS][3];
} result;

/* Swings of a joint about an axis through it: amplitude (rad), turns a second, phase. */
typedef struct swing {
    float size, rate, phase;
} swing;

static float swing_at(swing s, double time) {
    float sine, cosine;
    sine_cosine((float)fmod(s.rate * time + s.phase, 6.25), &sine, &cosine);
    return s.size * sine;
}

/* Rotations of a body that turns, bends and swings its arms; feet stay near the floor. */
static void pose_at(const swing swings[BS_JOINTS][3], double time, mat3 rotation[BS_JOINTS]) {
    const mat3 none = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int j = 0; j < BS_JOINTS; j++) {
        mat3 local = none;
        const vec3 turn = vec(swing_at(swings[j][0], time), swing_at(swings[j][1], time), swing_at(swings[j][2], time));
        if (j == LEFT_SHOULDER || j == RIGHT_SHOULDER) local = turned_by(local, vec(0, 0, j == LEFT_SHOULDER ? -0.9F : 0.9F));
        if (j == LEFT_ELBOW || j == RIGHT_ELBOW) local = turned_by(local, vec(0, j == LEFT_ELBOW ? -0.6F : 0.6F, 0));
        local = turned_by(local, turn);
        rotation[j] = j ? product(rotation[(int)PARENT[j]], local) : local;
    }
}

static void quaternion_from(mat3 m, double q[4]) {
    const double trace = (double)m.x.x + (double)m.y.y + (double)m.z.z;
    q[0] = 0.5 * sqrt(fmax(1.0 + trace, 0.0));
    q[1] = 0.5 * copysign(sqrt(fmax(1.0 + (double)m.x.x - (double)m.y.y - (double)m.z.z, 0.0)), (double)(m.y.z - m.z.y));
    q[2] = 0.5 * copysign(sqrt(fmax(1.0 - (double)m.x.x + (double)m.y.y - (double)m.z.z, 0.0)), (double)(m.z.x - m.x.z));
    q[3] = 0.5 * copysign(sqrt(fmax(1.0 - (double)m.x.x - (double)m.y.y + (double)m.z.z, 0.0)), (double)(m.x.y - m.y.x));
}

/* Draw a scene: head and any other points, with gaps, at any rate, of a body that is known or inferred. */
static void draw_scene(const bs_model *model, source_of_numbers *from, scene *s) {
    static const int32_t OTHERS[] = {LEFT_WRIST, RIGHT_WRIST, PELVIS, LEFT_ANKLE, RIGHT_ANKLE, LEFT_ELBOW, RIGHT_ELBOW,
                                     LEFT_KNEE, RIGHT_KNEE, SPINE3, LEFT_INDEX1};
    swing swings[BS_JOINTS][3];
    memset(s, 0, sizeof *s);
    memset(swings, 0, sizeof swings);
    s->settings = bs_default_settings();
    s->settings.floor = chance(from, 0.3) ? between(from, -2.0, 2.0) : 0.0;
    s->person.height = between(from, 1.4, 2.0);
    s->person.height_deviation = 0.01;
    if (bs_person_likeliest(model, &s->person) != BS_OK) exit(1);
    if (chance(from, 0.7)) memset(s->person.deviation, 0, sizeof s->person.deviation); /* known */
    for (int j = 0; j < BODY_JOINTS; j++) {
        const double most = j == PELVIS ? 0.15 : j >= LEFT_SHOULDER ? 0.4 : j == LEFT_HIP || j == RIGHT_HIP ? 0.3 : 0.1;
        for (int c = 0; c < 3; c++) { /* one draw a statement: the order of arguments is the compiler's */
            swings[j][c].size = (float)between(from, 0, most);
            swings[j][c].rate = (float)between(from, 1, 8);
            swings[j][c].phase = (float)between(from, 0, 6);
        }
    }
    s->point[s->points++] = HEAD;
    for (size_t k = 0; k < sizeof OTHERS / sizeof *OTHERS; k++)
        if (chance(from, k < 2 ? 0.8 : 0.3)) s->point[s->points++] = OTHERS[k];
    const double rate = between(from, 10, 144);
    vec3 place = vec(0, 0, 0);
    place.x = (float)between(from, -5, 5);
    place.z = (float)between(from, -5, 5);
    double time = between(from, 0, 100);
    bool placed[BS_POINTS], turned[BS_POINTS];
    for (int p = 0; p < s->points; p++) placed[p] = true, turned[p] = s->point[p] < BODY_JOINTS && chance(from, 0.7);
    for (int t = 0; t < FRAMES; t++) {
        mat3 rotation[BS_JOINTS];
        vec3 point[BS_POINTS];
        float lowest = 10.0F;
        s->time[t] = time += between(from, 0.8, 1.2) / rate;
        pose_at(swings, time, rotation);
        for (int p = 0; p < BS_POINTS; p++) {
            const double *o = s->person.rest_offset[p];
            const vec3 bone = p ? vec((float)o[0], (float)o[1], (float)o[2]) : vec(0, 0, 0);
            point[p] = p ? add(point[(int)PARENT[p]], rotate(rotation[(int)PARENT[p]], bone)) : place;
            lowest = fminf(lowest, point[p].y);
        }
        for (int p = 0; p < s->points; p++) {
            const int k = s->point[p];
            if (p && chance(from, 0.02)) placed[p] = !placed[p];
            s->position[t][p][0] = (double)point[k].x;
            s->position[t][p][1] = (double)(point[k].y - lowest) + s->settings.floor;
            s->position[t][p][2] = (double)point[k].z;
            if (k < BS_JOINTS) quaternion_from(rotation[k], s->rotation[t][p]);
            s->has_position[t][p] = placed[p];
            s->has_rotation[t][p] = turned[p];
            s->accuracy[t][p] = 0.001;
        }
    }
}

/* ---- runs -------------------------------------------------------------------------------------------------------- */

/* Frames from `first` of a scene, packed by its points. */
static bs_observation frames_of(const scene *s, int first, int frames, double *numbers, uint8_t *masks) {
    const size_t points = (size_t)s->points, count = (size_t)frames * points;
    double *position = numbers, *rotation = position + 3 * count, *accuracy = rotation + 4 * count;
    for (size_t t = 0; t < (size_t)frames; t++) {
        const size_t at = t * points, of = (size_t)first + t;
        memcpy(position + 3 * at, s->position[of], 3 * points * sizeof(double));
        memcpy(rotation + 4 * at, s->rotation[of], 4 * points * sizeof(double));
        memcpy(accuracy + at, s->accuracy[of], points * sizeof(double));
        memcpy(masks + at, s->has_position[of], points);
        memcpy(masks + count + at, s->has_rotation[of], points);
    }
    return (bs_observation){frames, s->points, s->point, s->time + first, position, rotation, masks, masks + count, accuracy,
                            NULL};
}

static bs_estimate estimate_of(result *r, int first) {
    return (bs_estimate){r->root[first], r->rotation[first][0], r->points[first][0], r->measured[first],
                         r->confidence[first], r->bound[first], r->contact[first], r->rest_offset[first][0]};
}

static bs_state *started(const bs_model *model, const scene *s) {
    bs_state *state;
    const size_t size = bs_state_size(model);
    if (bs_state_start(model, &s->person, memory_of(size), size, &state) != BS_OK) exit(1);
    return state;
}

/* Complete frames of people together, with the settings of the first. */
static void step(const bs_model *model, int people, const scene *s, int first, int frames, bs_state *const *state,
                 result *out) {
    bs_observation observation[PEOPLE];
    bs_estimate estimate[PEOPLE];
    double *numbers[PEOPLE];
    uint8_t *masks[PEOPLE];
    int refused;
    for (int k = 0; k < people; k++) {
        const size_t count = (size_t)frames * (size_t)s[k].points;
        numbers[k] = memory_of(8 * count * sizeof(double)), masks[k] = memory_of(2 * count);
        observation[k] = frames_of(&s[k], first, frames, numbers[k], masks[k]);
        estimate[k] = estimate_of(&out[k], first);
    }
    const size_t size = bs_scratch_size(model, people);
    void *scratch = memory_of(size);
    const bs_result done =
        bs_step(model, &s->settings, people, observation, state, estimate, scratch, size, &refused);
    expect(done == BS_OK, bs_message(done), refused, first, done);
    free(scratch);
    for (int k = 0; k < people; k++) free(numbers[k]), free(masks[k]);
}

static uint64_t hash_of(const void *bytes, size_t size, uint64_t hash) { /* FNV-1a */
    for (size_t k = 0; k < size; k++) hash = (hash ^ ((const uint8_t *)bytes)[k]) * 0x100000001B3U;
    return hash;
}

static const bs_model *opened(const char *file, size_t bytes, kernel kernel) {
    const bs_model *model;
    const size_t size = bs_model_size(file, bytes);
    const bs_result done = size ? model_open(file, bytes, kernel, memory_of(size), size, &model) : BS_MODEL_DAMAGED;
    if (done != BS_OK) fprintf(stderr, "the tiny model: %s\n", bs_message(done)), exit(1);
    return model;
}

/* The hash of all that some scenes give, state included. */
static uint64_t hash_of_run(const bs_model *model) {
    static scene s;
    static result r;
    source_of_numbers from = {11};
    uint64_t hash = 0xCBF29CE484222325U;
    for (int draw = 0; draw < 8; draw++) {
        draw_scene(model, &from, &s);
        bs_state *state = started(model, &s);
        step(model, 1, &s, 0, FRAMES, &state, &r);
        hash = hash_of(&r, sizeof r, hash);
        hash = hash_of(state, bs_state_size(model), hash);
        free(state);
    }
    return hash;
}

/* ---- properties -------------------------------------------------------------------------------------------------- */

static double distance_between(const double a[3], const double b[3]) {
    const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return sqrt(x * x + y * y + z * z);
}

static void bodies_are_finite(const scene *s, const result *r, int draw) {
    (void)s;
    for (int t = 0; t < FRAMES; t++) {
        double sum = 0.0;
        for (int p = 0; p < BS_POINTS; p++) {
            sum += r->points[t][p][0] + r->points[t][p][1] + r->points[t][p][2] + r->confidence[t][p] + r->bound[t][p];
            expect(r->confidence[t][p] > 0 && r->bound[t][p] > 0, "expected error", draw, t, r->confidence[t][p]);
        }
        for (int j = 0; j < BS_JOINTS; j++) {
            const double *q = r->rotation[t][j];
            const double size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
            expect(fabs(size - 1.0) < 1e-5, "length of a quaternion", draw, t, size);
        }
        expect(isfinite(sum), "a number that is not finite", draw, t, sum);
    }
}

static void bones_keep_their_lengths(const scene *s, const result *r, int draw) {
    static const double ORIGIN[3] = {0, 0, 0};
    (void)s;
    for (int t = 0; t < FRAMES; t++) {
        for (int p = 1; p < BS_POINTS; p++) {
            const double length = distance_between(r->rest_offset[t][p], ORIGIN);
            const double off = distance_between(r->points[t][p], r->points[t][(int)PARENT[p]]) - length;
            expect(fabs(off) < 1e-5, bs_point_name(p), draw, t, off);
        }
    }
}

static bool tracks(const scene *s, int point) {
    for (int p = 0; p < s->points; p++)
        if (s->point[p] == point) return true;
    return false;
}

/* Whether an arm is straight, so that its wrist may be out of reach. */
static bool is_straight(const result *r, int t, int wrist) {
    const int elbow = PARENT[wrist], shoulder = PARENT[elbow];
    const double *start = r->points[t][shoulder], *middle = r->points[t][elbow], *end = r->points[t][wrist];
    const double longest = distance_between(start, middle) + distance_between(middle, end);
    return distance_between(start, end) > 0.998 * longest;
}

/* A head is met at once, and wrists of a known body once they have been tracked for a while. A tracked elbow may keep a
 * wrist from its place, because nothing tells where the shoulder is. */
static void measured_points_are_met(const scene *s, const result *r, int draw) {
    double since[BS_POINTS] = {0};
    for (int t = 0; t < FRAMES; t++) {
        for (int p = 0; p < s->points; p++) {
            const int k = s->point[p];
            const double off = distance_between(r->points[t][k], s->position[t][p]);
            since[p] = s->has_position[t][p] ? since[p] + (t ? s->time[t] - s->time[t - 1] : 0.0) : 0.0;
            expect(r->measured[t][k] == s->has_position[t][p], "a measured point", draw, t, k);
            if (!s->has_position[t][p]) continue;
            if (k == HEAD) expect(off < 1e-5, "head", draw, t, off);
            else if ((k == LEFT_WRIST || k == RIGHT_WRIST) && !tracks(s, PARENT[k]) && s->person.deviation[HEAD] == 0.0 &&
                     since[p] > 0.5 && !is_straight(r, t, k))
                expect(off < MET, bs_point_name(k), draw, t, off);
        }
    }
}

/* Legs without trackers only: a tracked ankle or knee is met for any turn of the foot. */
static void feet_are_not_under_the_floor(const scene *s, const result *r, int draw) {
    static const int FEET[] = {LEFT_ANKLE, RIGHT_ANKLE, LEFT_FOOT, RIGHT_FOOT, LEFT_TOE, RIGHT_TOE};
    for (int t = 0; t < FRAMES; t++) {
        for (size_t k = 0; k < sizeof FEET / sizeof *FEET; k++) {
            if (tracks(s, k % 2 ? RIGHT_ANKLE : LEFT_ANKLE) || tracks(s, k % 2 ? RIGHT_KNEE : LEFT_KNEE)) continue;
            const double under = s->settings.floor - r->points[t][FEET[k]][1];
            expect(under < SINK, bs_point_name(FEET[k]), draw, t, under);
        }
    }
}

/* A knee that is not tracked bends backward only as far as a straight leg does: the ankle is never before the thigh. */
static void knees_do_not_bend_backward(const scene *s, const result *r, int draw) {
    static const int LEG[2][3] = {{LEFT_HIP, LEFT_KNEE, LEFT_ANKLE}, {RIGHT_HIP, RIGHT_KNEE, RIGHT_ANKLE}};
    if (tracks(s, LEFT_KNEE) || tracks(s, RIGHT_KNEE)) return;
    for (int t = 0; t < FRAMES; t++) {
        for (int side = 0; side < 2; side++) {
            const double *q = r->rotation[t][LEG[side][1]]; /* of the shin in the thigh's axes */
            const double forward = 2.0 * (q[2] * q[3] - q[0] * q[1]); /* of the ankle, which is down in the rest pose */
            expect(forward < HINGE, bs_point_name(LEG[side][1]), draw, t, forward);
        }
    }
}

typedef void property(const scene *s, const result *r, int draw);

static void over_draws(const bs_model *model, property *holds) {
    static scene s;
    static result r;
    source_of_numbers from = {3};
    for (int draw = 0; draw < DRAWS; draw++) {
        draw_scene(model, &from, &s);
        bs_state *state = started(model, &s);
        step(model, 1, &s, 0, FRAMES, &state, &r);
        holds(&s, &r, draw);
        free(state);
    }
}

/* ---- equalities -------------------------------------------------------------------------------------------------- */

/* Frames one by one, through a state that is copied as bytes before each, equal all frames in one call. */
static void a_state_is_its_bytes(const bs_model *model) {
    static scene s;
    static result whole, single;
    source_of_numbers from = {5};
    const size_t size = bs_state_size(model);
    for (int draw = 0; draw < DRAWS / 4; draw++) {
        draw_scene(model, &from, &s);
        bs_state *state = started(model, &s), *other = started(model, &s);
        step(model, 1, &s, 0, FRAMES, &state, &whole);
        for (int t = 0; t < FRAMES; t++) {
            void *copy = memory_of(size);
            memcpy(copy, other, size);
            free(other);
            expect(bs_state_open(model, copy, size, &other) == BS_OK, "a copied state", draw, t, 0);
            step(model, 1, &s, t, 1, &other, &single);
        }
        expect(memcmp(&whole, &single, sizeof whole) == 0, "frames one by one", draw, 0, 0);
        expect(memcmp(state, other, size) == 0, "the state after them", draw, 0, 0);
        free(state);
        free(other);
    }
}

static void a_batch_equals_each_alone(const bs_model *model) {
    static scene s[PEOPLE];
    static result together[PEOPLE], alone;
    source_of_numbers from = {9};
    for (int draw = 0; draw < DRAWS / 4; draw++) {
        bs_state *state[PEOPLE];
        for (int k = 0; k < PEOPLE; k++) {
            draw_scene(model, &from, &s[k]);
            s[k].settings = s->settings;
            state[k] = started(model, &s[k]);
        }
        step(model, PEOPLE, s, 0, FRAMES, state, together);
        for (int k = 0; k < PEOPLE; k++) {
            bs_state *one = started(model, &s[k]);
            step(model, 1, &s[k], 0, FRAMES, &one, &alone);
            expect(memcmp(&together[k], &alone, sizeof alone) == 0, "a person of a batch", draw, k, 0);
            expect(memcmp(state[k], one, bs_state_size(model)) == 0, "the state of one", draw, k, 0);
            free(one);
            free(state[k]);
        }
    }
}

static void every_kernel_gives_the_golden_run(const char *file, size_t bytes) {
    for (int place = 0; place < KERNELS; place++) {
        const kernel kernel = kernel_at(place);
        if (!kernel.multiply) continue;
        const bs_model *model = opened(file, bytes, kernel);
        const uint64_t hash = hash_of_run(model);
        if (hash != GOLDEN) fprintf(stderr, "  kernel %s: 0x%016llX\n", kernel.name, (unsigned long long)hash);
        expect(hash == GOLDEN, "the golden hash (`make golden` after a change of results)", place, 0, 0);
        free((void *)(uintptr_t)model);
    }
}

/* A tuned number that is halved, doubled or removed changes what it does. */
static void tuned_numbers_do_what_they_say(const bs_model *model) {
    for (size_t k = 0; k < sizeof TUNED / sizeof *TUNED; k++) {
        const double value = TUNED[k].measured(model);
        expect(fabs(value / TUNED[k].value - 1.0) < TUNED_BAND, TUNED[k].name, (int)k, 0, value);
    }
}

/* Own functions are as exact as the library's. */
/* A body is balanced by what is predicted of it: not if a point of its trunk or of a leg is measured. */
static void measured_bodies_are_not_balanced(const bs_model *model) {
    static const int STANDS[] = {PELVIS, LEFT_HIP, SPINE1, RIGHT_KNEE, SPINE2, LEFT_ANKLE, SPINE3, RIGHT_FOOT, LEFT_TOE};
    static leaning l;
    for (int k = 0; k < (int)(sizeof STANDS / sizeof *STANDS); k++) {
        for (int rotated = 0; rotated < 2; rotated++) {
            if (rotated && STANDS[k] >= BODY_JOINTS) continue;
            lean(&l, model, 0.3, 1.0, 0.0);
            if (rotated) l.seen.has_rotation[STANDS[k]] = true;
            else l.seen.has_position[STANDS[k]] = true;
            const prediction before = l.predicted;
            balance_prediction(&l.seen, &l.state, &l.predicted);
            expect(memcmp(&before, &l.predicted, sizeof before) == 0, "a measured body is balanced", k, rotated, 0.0);
        }
    }
}

/* A body that leans too little to be turned is not turned either in the frame in which a point of it comes. */
static void points_that_come_turn_no_body(const bs_model *model) {
    static leaning l;
    for (int k = -20; k <= 20; k++) {
        const double angle = 0.005 * k;
        if (turned_back(model, angle, 1.0) > 0.0) continue;
        lean(&l, model, angle, 1.0, 0.0);
        balance_prediction(&l.seen, &l.state, &l.predicted);
        l.state.begun = 1;
        l.seen.has_position[PELVIS] = true;
        const prediction before = l.predicted;
        balance_prediction(&l.seen, &l.state, &l.predicted);
        expect(memcmp(&before, &l.predicted, sizeof before) == 0, "a point that comes turns a body", k, 1, angle);
    }
}

static void functions_are_exact(void) {
    source_of_numbers from = {13};
    for (int k = 0; k < 20000; k++) {
        const double x = between(&from, -30, 30), y = between(&from, 0, 30);
        float sine, cosine;
        sine_cosine((float)x, &sine, &cosine);
        expect(fabs((double)sine - sin((double)(float)x)) < 1e-7, "sine", k, 0, x);
        expect(fabs((double)cosine - cos((double)(float)x)) < 1e-7, "cosine", k, 0, x);
        const float side = (float)(k % 2 ? -y : y);
        const double angle = atan2((double)side, (double)(float)x);
        expect(fabs((double)angle_of(side, (float)x) - angle) < 3e-7, "angle", k, 0, angle);
        expect(fabs(exponential_double(x) / exp(x) - 1.0) < 1e-14, "e^x", k, 0, x);
        expect(fabs((double)exponential((float)x) / exp((double)(float)x) - 1.0) < 1e-6, "e^x of a float", k, 0, x);
        expect(fabs((double)power_of_two((float)x) / exp2((double)(float)x) - 1.0) < 3e-6, "2^x", k, 0, x);
        if (y > 1e-3) expect(fabs(logarithm_double(y) - log(y)) < 1e-14 * (1.0 + fabs(log(y))), "logarithm", k, 0, y);
    }
}

/* A random body whose joints are turned by as much as `spread` (rad). */
static void turn_joints(source_of_numbers *from, double spread, int32_t joints, double *local) {
    for (int32_t j = 0; j < joints; j++) {
        const double half[3] = {between(from, -spread, spread) / 2, between(from, -spread, spread) / 2,
                                between(from, -spread, spread) / 2};
        double *q = local + 4 * j;
        const double size = sqrt(1 + half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
        for (int k = 0; k < 4; k++) q[k] = (k ? half[k - 1] : 1) / size;
    }
}

/* Any tree reaches the points of another of its poses, by as many doubles of memory as it asks for. */
static void targets_are_reached(void) {
    enum { MOST_JOINTS = 20, MOST_POINTS = 30 };
    source_of_numbers from = {17};
    for (int draw = 0; draw < DRAWS; draw++) {
        const int32_t joints = 1 + (int32_t)between(&from, 0, MOST_JOINTS - 1);
        const int32_t points = joints + (int32_t)between(&from, 0, MOST_POINTS - MOST_JOINTS);
        int32_t parent[MOST_POINTS] = {-1};
        double offset[MOST_POINTS][3], lever[MOST_JOINTS], stiffness[MOST_JOINTS][3] = {{0}}, relaxed[MOST_JOINTS][3];
        for (int32_t p = 0; p < points; p++) {
            if (p) parent[p] = (int32_t)between(&from, 0, p < joints ? p : joints);
            for (int k = 0; k < 3; k++) offset[p][k] = between(&from, -0.3, 0.3);
        }
        for (int32_t j = 0; j < joints; j++) {
            lever[j] = 0.3;
            for (int k = 0; k < 3; k++) stiffness[j][k] = j ? 1e-5 : 0, relaxed[j][k] = 0;
        }
        const bs_posable body = {{joints, points, parent, offset[0]}, lever, stiffness[0], relaxed[0]};
        const bs_descent descent = {1e-12, 1e-7, 1e-3, 1e6, 100}, none = {1e-12, 1e-7, 1e-3, 1e6, 0};
        double root[3] = {1, 2, 3}, local[MOST_JOINTS][4], world[MOST_JOINTS][4], position[MOST_POINTS][3];
        double target[MOST_POINTS][3], weight[MOST_POINTS], tension[MOST_POINTS], found[MOST_POINTS][3];
        for (int32_t p = 0; p < points; p++) weight[p] = between(&from, 0.5, 2);
        turn_joints(&from, 0.5, joints, local[0]);
        bs_place_frames(&body.tree, 1, root, local[0], target[0], world[0]);
        turn_joints(&from, 0.1, joints, local[0]);
        bs_place_frames(&body.tree, 1, root, local[0], position[0], world[0]);
        double *memory = malloc(bs_reach_memory(&body.tree) * sizeof *memory);
        if (!memory) exit(1);
        const bs_targets targets = {target[0], weight, NULL, NULL};
        bs_reached reached = {root, world[0], local[0], found[0], tension, 0, 0};
        bs_reach_targets(&body, &none, &targets, &reached, memory);
        double off = 0, placed = 0, cost = reached.cost;
        for (int32_t p = 0; p < points; p++)
            for (int k = 0; k < 3; k++) placed = fmax(placed, fabs(found[p][k] - position[p][k]));
        expect(placed < 1e-12, "the points of a body without a step", draw, 0, placed);
        bs_reach_targets(&body, &descent, &targets, &reached, memory);
        free(memory);
        bs_place_frames(&body.tree, 1, root, local[0], position[0], world[0]);
        for (int32_t p = 0; p < points; p++)
            for (int k = 0; k < 3; k++) {
                off = fmax(off, fabs(found[p][k] - target[p][k]));
                placed = fmax(placed, fabs(found[p][k] - position[p][k]));
            }
        expect(off < 1e-4, "a target is not reached", draw, 0, off);
        expect(placed < 1e-12, "points are not those of the rotations", draw, 0, placed);
        expect(reached.cost <= cost, "the cost rises", draw, 0, reached.cost);
    }
}

/* ---- the program ------------------------------------------------------------------------------------------------- */

static int ran;

static bool begins(const char *name, const char *filter) {
    if (!strstr(name, filter)) return false;
    printf("%s\n", name);
    fflush(stdout);
    failures_before = failures;
    ran++;
    return true;
}

static void run_tests(const bs_model *model, const char *file, size_t bytes, const char *filter) {
    static const struct {
        const char *name;
        property *holds;
    } PROPERTIES[] = {{"bodies_are_finite", bodies_are_finite},
                      {"bones_keep_their_lengths", bones_keep_their_lengths},
                      {"measured_points_are_met", measured_points_are_met},
                      {"feet_are_not_under_the_floor", feet_are_not_under_the_floor},
                      {"knees_do_not_bend_backward", knees_do_not_bend_backward}};
    for (size_t k = 0; k < sizeof PROPERTIES / sizeof *PROPERTIES; k++)
        if (begins(PROPERTIES[k].name, filter)) over_draws(model, PROPERTIES[k].holds);
    if (begins("a_state_is_its_bytes", filter)) a_state_is_its_bytes(model);
    if (begins("a_batch_equals_each_alone", filter)) a_batch_equals_each_alone(model);
    if (begins("every_kernel_gives_the_golden_run", filter)) every_kernel_gives_the_golden_run(file, bytes);
    if (begins("tuned_numbers_do_what_they_say", filter)) tuned_numbers_do_what_they_say(model);
    if (begins("measured_bodies_are_not_balanced", filter)) measured_bodies_are_not_balanced(model);
    if (begins("points_that_come_turn_no_body", filter)) points_that_come_turn_no_body(model);
    if (begins("functions_are_exact", filter)) functions_are_exact();
    if (begins("targets_are_reached", filter)) targets_are_reached();
    printf("%d tests on kernel %s, %d failures\n", ran, bs_model_kernel(model), failures);
}

int main(int count, char **arguments) {
    const char *filter = count > 1 ? arguments[1] : "";
    size_t bytes;
    char *file = random_model(MODEL_SEED, &bytes);
    const bs_model *model = opened(file, bytes, fastest_kernel());
    if (strcmp(filter, "--golden") == 0) {
        printf("/* The hash of the golden run (test.c). `make golden` writes it anew after a change of results. */\n"
               "#define GOLDEN 0x%016llXU\n",
               (unsigned long long)hash_of_run(model));
        ran = 1;
    } else if (strcmp(filter, "--write") == 0 && count == 3) {
        FILE *to = fopen(arguments[2], "wb");
        ran = to && fwrite(file, 1, bytes, to) == bytes && fclose(to) == 0;
    } else run_tests(model, file, bytes, filter);
    free((void *)(uintptr_t)model);
    free(file);
    return failures > 0 || ran == 0;
}
