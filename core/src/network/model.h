/* An open model: tables as the products read them. */
#ifndef BODYSENSE_MODEL_H
#define BODYSENSE_MODEL_H

#include "../base/internal.h"
#include "../base/maths.h"
#include "../base/skeleton.h"
#include "../products/matrix.h"

#define MOST_LAYERS 4
#define ERROR_HIDDEN 96                                 /* of the map that makes expected errors true */
#define ERROR_KNOWN (3 * BODY_POINTS + 2 * BODY_JOINTS) /* what it reads */
#define HAND_OUTPUTS (6 * HAND_JOINTS + HAND_POINTS)    /* of the finger network, for each hand */
#define TURNED (6 * BODY_JOINTS + 3)                    /* outputs of the branch that turns joints and places the head */
#define JUDGED (BS_CONTACTS + BODY_POINTS)              /* of the branch that judges contact and error */

/* A product of two matrices of low rank, which is added to another product while the head's pose is not tracked (Hu et
 * al. 2022, "LoRA"). inward.rows is 0 where a model has none. */
typedef struct update {
    matrix inward, outward;
} update;

/* A recurrent layer (GRU). Rows are those of the reset gate, of the update gate and of the candidate. */
typedef struct recurrent {
    matrix of_input, of_state;
    update input_update, state_update;
    const float *input_bias, *state_bias; /* (3 × hidden) */
} recurrent;

/* A layer of rectified units over what a network remembers and what it reads, and the start of the one behind it. */
typedef struct branch {
    matrix of_hidden, of_features;
    update hidden_update, features_update;
    const float *bias;
    table out;
    const float *out_bias;
} branch;

struct bs_model {
    uint64_t fingerprint;
    kernel kernel;
    bool reads_unplaced_head;      /* trained with heads that are turned but have no place */
    int features, hand_features;   /* numbers that the networks read of a body, of a hand */
    int layers, hidden, hand_hidden;
    int rank;                      /* of the updates */
    recurrent layer[MOST_LAYERS], hands;
    branch turn, judge, fingers;
    const float *usual_bones;      /* (25, 3) rest offsets of the default body, by its stature */
    const float *standing;         /* (22, 3, 2) x and y axes of joints of a standing body, as columns */
    const float *usual_fingers;    /* (20, 3) rest offsets of the default left hand, by its size */
    const float *relaxed;          /* (15, 3, 2) x and y axes of joints of a relaxed left hand, from the wrist */
    const double *shape_mean;      /* (65, 3) m: rest offsets of the likeliest adult */
    const double *shape_components; /* (16, 65, 3) m */
    table error_inward, error_weight; /* (96, 119), (50, 119 + 96) */
    const float *error_inward_offset, *error_offset;
};

/* Open a model with a kernel of choice. No kernel needs more memory than `bs_model_size` asks for. */
bs_result model_open(const void *file, size_t bytes, kernel kernel, void *memory, size_t size, const bs_model **model);

#define SHAPE_SIZE 16 /* directions in which proportions of people differ */

static inline const double *model_shape_mean(const bs_model *model) { return model->shape_mean; }
static inline const double *model_shape_components(const bs_model *model) { return model->shape_components; }

/* Numbers that the body's network reads without, and with accelerations. */
#define FEATURES 489
#define STRAPPED_JOINTS 12
#define FEATURES_ACCELERATION (FEATURES + 4 * STRAPPED_JOINTS)
#define HAND_FEATURES (7 * HAND_POINTS + 7 * HAND_JOINTS + 13)

#endif
