#include "state.h"
#include "pose.h"

#include <string.h>

#include "../network/model.h"
#include "../network/network.h"
#include "../person/shape.h"

bs_result bs_person_likeliest(const bs_model *model, bs_person *person) {
    bs_person checked = *person;
    measurements known = {person->height, person->height_deviation, .is_stated = true};
    likeliest_body(model, &(measurements){.height = NAN}, checked.rest_offset, checked.deviation);
    bs_result result = check_person(&checked);
    if (result != BS_OK) return result;
    known.lengths = person->lengths;
    memcpy(known.length, person->length, (size_t)known.lengths * sizeof *known.length);
    likeliest_body(model, &known, checked.rest_offset, checked.deviation);
    result = check_person(&checked); /* lengths that are possible alone may not be together */
    if (result == BS_OK) *person = checked;
    return result;
}

size_t bs_state_size(const bs_model *model) {
    return aligned(sizeof(bs_state)) + aligned(network_memory(model) * sizeof(float));
}

bs_result bs_state_start(const bs_model *model, const bs_person *person, void *memory, size_t size, bs_state **state) {
    bs_state *own = memory;
    bs_result result = check_person(person);
    if (result != BS_OK) return result;
    if (size < bs_state_size(model) || !is_aligned(memory)) return BS_MEMORY_SMALL;
    memset(memory, 0, bs_state_size(model)); /* padding too: equal states have equal bytes */
    memcpy(own->format, STATE_FORMAT, sizeof own->format);
    own->model = model_fingerprint(model);
    own->size = bs_state_size(model);
    own->time = NAN;
    memcpy(&own->person, person, sizeof *person);
    proportions_start(person, &own->proportions);
    mounts_start(person, &own->mounts);
    pose_start(&own->pose);
    network_start(model, state_memory(own));
    *state = own;
    return BS_OK;
}

bs_result bs_state_open(const bs_model *model, void *memory, size_t size, bs_state **state) {
    bs_state *own = memory;
    if (!is_aligned(memory)) return BS_MEMORY_SMALL;
    if (size < sizeof *own || memcmp(own->format, STATE_FORMAT, sizeof own->format) != 0) return BS_STATE_FOREIGN;
    if (own->model != model_fingerprint(model) || own->size != bs_state_size(model)) return BS_STATE_FOREIGN;
    if (size < own->size) return BS_MEMORY_SMALL;
    if (check_person(&own->person) != BS_OK) return BS_STATE_FOREIGN;
    *state = own;
    return BS_OK;
}

double bs_state_time(const bs_state *state) { return state->time; }

void bs_state_person(const bs_state *state, bs_person *person) {
    *person = state->person;
    memcpy(person->rest_offset, state->proportions.believed, sizeof person->rest_offset);
    memcpy(person->deviation, state->proportions.deviation, sizeof person->deviation);
    if (state->proportions.released) person->height = NAN;
    mounts_person(&state->mounts, person);
}

int bs_state_contradicts_height(const bs_state *state) { return state->proportions.released; }

bs_result bs_state_update_person(const bs_model *model, bs_state *state, const bs_person *person) {
    bs_result result = check_person(person);
    if (result != BS_OK) return result;
    mounts_update(&state->person, person, &state->mounts);
    proportions_update(model, &state->person, person, &state->proportions);
    memcpy(&state->person, person, sizeof *person);
    return BS_OK;
}
