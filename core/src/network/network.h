/* The networks: what a model predicts of a body, its fingers and its errors. */
#ifndef BODYSENSE_NETWORK_H
#define BODYSENSE_NETWORK_H

#include "../base/internal.h"

/* Number of floats that the networks remember of one person. */
size_t network_memory(const bs_model *model);

/* Fill `memory` with that of a person before the first frame. */
void network_start(const bs_model *model, float *memory);

/* Bytes of scratch that the functions below need for `people` people. */
size_t network_scratch(const bs_model *model, int people);

/* Predict a body each of `people` people.
 *
 * Finds the frame under the head. `memory` advances at most 65 times a second: frames of faster devices are all
 * answered from the memory of the last one that advanced. `scratch` is aligned to 64 bytes.
 */
void predict_bodies(const bs_model *model, int people, const tracked *seen, head_frame *frame, float *const *memory,
                    prediction *out, void *scratch);

/* Complete the fingers of each person, after `predict_bodies` in the same frame and exactly once.
 *
 * The rotations of the body's joints and the places of its points are final; this fills rotations and points of both
 * hands, and remembers the body for the next frame. `finger_error` is m, expected, without the wrist's own error: of
 * the left hand's joints, then of its tips, then of the right hand's.
 */
void complete_fingers(const bs_model *model, int people, const tracked *seen, const head_frame *frame, body *out,
                      float *const *memory, float (*finger_error)[2 * HAND_POINTS], void *scratch);

/* Expected errors of all points of one person, and the bounds that nine of ten errors keep.
 *
 * `off` is m, how far a measured point is from where the body has it: no measured point is expected to err by less.
 */
void expected_errors(const bs_model *model, const tracked *seen, const prediction *predicted,
                     const float finger_error[2 * HAND_POINTS], const float off[BS_POINTS],
                     float confidence[BS_POINTS], float bound[BS_POINTS]);

/* A number that identifies a model: a hash of its file. */
uint64_t model_fingerprint(const bs_model *model);

#endif
