/* bodysense: completes a human body, hands included, from partial tracking, in real time.
 *
 * The whole public interface. Conventions: right-handed, +Y up, metres, seconds; quaternions w, x, y, z; a body at
 * rest is in a T-pose, faces +Z, its left hand toward +X. Nothing here allocates, locks or has global state: models,
 * states and scratch are memory of the caller's, aligned to 64 bytes, and any number of threads may step different
 * states of one model.
 *
 *     bs_model_open → bs_state_start, once a person → bs_step, with each new frame
 */
#ifndef BODYSENSE_H
#define BODYSENSE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility push(default)
#endif

#define BS_VERSION 1     /* of this header; bs_version() gives the library's */
#define BS_JOINTS 52     /* 22 joints of the body, then 15 of each hand */
#define BS_POINTS 65     /* the joints, then 13 end sites: head top, toe tips, finger tips */
#define BS_CONTACTS 4    /* left ankle, right ankle, left ball, right ball */
#define BS_LENGTHS 32    /* distances that may be known of a person */
#define BS_MOST_PEOPLE 4096 /* in one call */

typedef enum bs_result {
    BS_OK = 0,
    BS_MODEL_DAMAGED,    /* the weights are truncated or not a safetensors file */
    BS_MODEL_FOREIGN,    /* a safetensors file of another kind */
    BS_MODEL_NEWER,      /* written for a newer library */
    BS_MODEL_INCOMPLETE, /* a tensor is missing or has another shape */
    BS_MEMORY_SMALL,     /* the memory given is smaller than the size asked for, or not aligned */
    BS_STATE_FOREIGN,    /* a state that was not started with this model */
    BS_TIME_DISORDERED,  /* time is not finite, or does not increase */
    BS_VALUE_NOT_FINITE, /* a tracked position or accuracy is NaN, infinite or beyond 1 km, or a rotation not of length 1 */
    BS_POINT_UNKNOWN,    /* a point's index is not below BS_POINTS */
    BS_PERSON_IMPOSSIBLE, /* offsets, deviations or lengths that no person has */
    BS_SETTING_IMPOSSIBLE, /* a setting is not finite or out of its range */
    BS_COUNT_IMPOSSIBLE  /* fewer than one or more than BS_MOST_PEOPLE people, or unequal numbers of frames */
} bs_result;

/* The meaning of a result and its fix, one line of English. Never NULL. */
const char *bs_message(bs_result result);

/* BS_VERSION of the library. */
int bs_version(void);

/* The name of a point, such as "left_elbow"; NULL if the index is not below BS_POINTS. */
const char *bs_point_name(int point);

/* ---- model ------------------------------------------------------------------------------------------------------- */

typedef struct bs_model bs_model;

/* Bytes of memory that a model needs, for a file of weights in memory; 0 if the file is damaged. */
size_t bs_model_size(const void *file, size_t bytes);

/* Open a model in `memory`. The file may be freed afterwards.
 *
 * A step reads all weights. It is faster in huge pages, above all if other work empties the caches between frames: on
 * Linux, align `memory` to 2 MB and call madvise(memory, size, MADV_HUGEPAGE) before.
 */
bs_result bs_model_open(const void *file, size_t bytes, void *memory, size_t size, const bs_model **model);

/* Name of the matrix kernel in use: "avx512vnni", "avx2", "neondot", "neon", "simd128" or "plain". */
const char *bs_model_kernel(const bs_model *model);

/* ---- person ------------------------------------------------------------------------------------------------------ */

typedef struct bs_length {
    int32_t start, end; /* points of the T-pose */
    double value;       /* m */
    double deviation;   /* m, standard deviation; above 0 */
} bs_length;

typedef struct bs_mount { /* mounting of a tracker: T_joint_tracker */
    uint8_t worn;         /* 1 if the joint carries a tracker whose mounting is known */
    uint8_t rotation_only; /* 1 for an inertial sensor, of which only the rotation is known */
    double translation[3]; /* m, in the joint's axes */
    double rotation[4];    /* wxyz */
} bs_mount;

typedef struct bs_person {
    double rest_offset[BS_POINTS][3]; /* m, from the parent in the T-pose; the root's from the floor */
    double deviation[BS_POINTS];      /* m, standard deviation of each bone's length; all 0: known exactly */
    double height;                    /* m, floor to crown; NaN if unknown */
    double height_deviation;          /* m, standard deviation */
    int32_t lengths;                  /* how many of `length` are known */
    bs_length length[BS_LENGTHS];
    bs_mount mount[BS_JOINTS];
} bs_person;

/* The likeliest adult: fills `rest_offset` and `deviation` from `height` and `length`. */
bs_result bs_person_likeliest(const bs_model *model, bs_person *person);

/* ---- state ------------------------------------------------------------------------------------------------------- */

typedef struct bs_state bs_state; /* plain bytes: may be copied, stored and sent */

size_t bs_state_size(const bs_model *model);

/* The state before the first frame of a person. */
bs_result bs_state_start(const bs_model *model, const bs_person *person, void *memory, size_t size, bs_state **state);

/* Use bytes that were a state as one again. Refuses those of another model or version. */
bs_result bs_state_open(const bs_model *model, void *memory, size_t size, bs_state **state);

/* Time (s) of the last frame; NaN before the first. */
double bs_state_time(const bs_state *state);

/* The person as believed now. */
void bs_state_person(const bs_state *state, bs_person *person);

/* 1 if the head was higher than the known height allows for 2 s: the height counts no more, and is inferred; else 0. */
int bs_state_contradicts_height(const bs_state *state);

/* Keep the evidence after the known parts of a person change. */
bs_result bs_state_update_person(const bs_model *model, bs_state *state, const bs_person *person);

/* ---- step -------------------------------------------------------------------------------------------------------- */

typedef struct bs_settings {
    double floor;       /* m, height of the floor; 0 */
    double ease;        /* s in which a point that is seen again is reached, at most 10; 0.25; 0: at once */
    double longest_gap; /* s without frames after which motion starts anew; 1 */
    double first;       /* s, interval that a first frame counts as, 1e-4 to 10; 1/30 */
    double longest;     /* s, a longer interval that is no gap counts as this, 1e-4 to 10; 0.1 */
    int32_t hold_feet;  /* 1: standing feet are held, and feet stay above the floor */
    int32_t infer;      /* 1: infer unknown proportions and mountings of trackers */
} bs_settings;

bs_settings bs_default_settings(void);

/* T frames of one person. Arrays are contiguous, frame after frame. Values of what is not tracked are ignored. */
typedef struct bs_observation {
    int32_t frames;              /* T, at least 1 */
    int32_t points;              /* P */
    const int32_t *point;        /* (P) which points these are */
    const double *time;          /* (T) s, increasing */
    const double *position;      /* (T, P, 3) m, world */
    const double *rotation;      /* (T, P, 4) wxyz, world ← joint */
    const uint8_t *has_position; /* (T, P) 1 or 0 */
    const uint8_t *has_rotation; /* (T, P) 1 or 0; of joints */
    const double *accuracy;      /* (T, P) m, expected error of a position; above 0 */
    const double *acceleration;  /* (T, P, 3) m/s², world, without gravity; NaN where absent. NULL: none */
} bs_observation;

/* Where T frames of one person are written. Members that are NULL are left out. */
typedef struct bs_estimate {
    double *root_position; /* (T, 3) m, world */
    double *rotation;      /* (T, 52, 4) wxyz, parent ← joint; the root's is world ← root */
    double *points;        /* (T, 65, 3) m, world */
    uint8_t *measured;     /* (T, 65) 1 where a position was tracked */
    double *confidence;    /* (T, 65) m, expected error of a point */
    double *bound;         /* (T, 65) m, within which nine of ten errors are */
    double *contact;       /* (T, 4) probability that a part of a foot stands */
    double *rest_offset;   /* (T, 65, 3) m, the proportions in use */
} bs_estimate;

/* Bytes of scratch that a step of `people` people needs. */
size_t bs_scratch_size(const bs_model *model, int people);

/* Complete the next frames of `people` people, each with the same number of frames.
 *
 * One call with T frames equals T calls with one, and a batch equals each person alone. If a frame is refused, the
 * result says why, `*refused` is the person, and all frames before it are done.
 */
bs_result bs_step(const bs_model *model, const bs_settings *settings, int people,
                  const bs_observation *observation, bs_state *const *state, const bs_estimate *estimate,
                  void *scratch, size_t scratch_size, int *refused);

#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility pop
#endif
#ifdef __cplusplus
}
#endif
#endif
