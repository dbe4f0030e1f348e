#include "internal.h"

int bs_version(void) { return BS_VERSION; }

const char *bs_message(bs_result result) {
    switch (result) {
    case BS_OK: return "no error";
    case BS_MODEL_DAMAGED: return "the weights are truncated or not a safetensors file; copy the file again";
    case BS_MODEL_FOREIGN: return "the weights are not bodysense-completion's; give completion.safetensors";
    case BS_MODEL_NEWER: return "the weights were written for a newer library; update bodysense";
    case BS_MODEL_INCOMPLETE: return "a tensor of the weights is missing or has another shape; export the network again";
    case BS_MEMORY_SMALL: return "the memory is too small or not aligned to 64 bytes; ask for its size";
    case BS_STATE_FOREIGN: return "the state was not started with this model; start a new one";
    case BS_TIME_DISORDERED: return "time is not finite or does not increase; give frames in order of time, in seconds";
    case BS_VALUE_NOT_FINITE: return "a tracked value is not finite, a position beyond 1 km, an accuracy not above 0, or a "
                                     "quaternion not of length 1; clear its mask, or give metres";
    case BS_POINT_UNKNOWN: return "a point is not below BS_POINTS; see bs_point_name";
    case BS_PERSON_IMPOSSIBLE: return "no person has these offsets, deviations, lengths or mounts; give metres";
    case BS_SETTING_IMPOSSIBLE: return "a setting is not finite or out of its range; begin with bs_default_settings";
    case BS_COUNT_IMPOSSIBLE: return "give 1 to BS_MOST_PEOPLE people, each with the same number of frames, at least 1";
    }
    return "unknown result; the header is of another version than the library";
}

const char *bs_point_name(int point) {
#define FINGER(side, name) side "_" name "1", side "_" name "2", side "_" name "3"
#define HAND(side) \
    FINGER(side, "index"), FINGER(side, "middle"), FINGER(side, "pinky"), FINGER(side, "ring"), FINGER(side, "thumb")
#define BOTH(name) "left_" name, "right_" name
    static const char *const NAME[BS_POINTS] = {
        "pelvis", BOTH("hip"), "spine1", BOTH("knee"), "spine2", BOTH("ankle"), "spine3", BOTH("foot"), "neck",
        BOTH("collar"), "head", BOTH("shoulder"), BOTH("elbow"), BOTH("wrist"), HAND("left"), HAND("right"),
        "head_top", BOTH("toe"), BOTH("index_tip"), BOTH("middle_tip"), BOTH("pinky_tip"), BOTH("ring_tip"),
        BOTH("thumb_tip"),
    };
    return point >= 0 && point < BS_POINTS ? NAME[point] : NULL;
}
