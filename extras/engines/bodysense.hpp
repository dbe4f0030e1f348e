// C++17 over bodysense.h for engines: owns the memory that the C interface asks for. Throws nothing.
//
// World and rotations are those of bodysense.h: right-handed, +Y up, metres, quaternions w, x, y, z, a T-pose at rest
// that faces +Z, the left hand toward +X. Each engine's listing turns them into its own axes.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "bodysense.h"

namespace bodysense {

// The parent of each joint; parents come before their children.
constexpr int PARENTS[BS_JOINTS] = {
    -1, 0,  0,  0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  9,  9,  12, 13, 14, 16, 17, 18, 19, 20, 22, 23, 20,
    25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50};

// The index of a point's name, such as "left_elbow"; -1 if there is none.
inline int point_of(const char *name) {
    for (int p = 0; p < BS_POINTS; ++p)
        if (std::strcmp(bs_point_name(p), name) == 0) return p;
    return -1;
}

// Bytes at a multiple of 64.
class Memory {
  public:
    explicit Memory(std::size_t size) : bytes_(size + 64), size_(size) {}
    Memory(const Memory &) = delete;
    Memory &operator=(const Memory &) = delete;
    void *at() { return bytes_.data() + (64 - reinterpret_cast<std::uintptr_t>(bytes_.data()) % 64); }
    std::size_t size() const { return size_; }

  private:
    std::vector<unsigned char> bytes_;
    std::size_t size_;
};

// A network, which any number of bodies share. It must outlive them.
class Model {
  public:
    // Open the content of completion.safetensors.
    bs_result open(const void *file, std::size_t bytes) {
        const std::size_t size = bs_model_size(file, bytes);
        if (bs_version() != BS_VERSION || !size) return size ? BS_MODEL_NEWER : BS_MODEL_DAMAGED;
        memory_ = std::make_unique<Memory>(size);
        return bs_model_open(file, bytes, memory_->at(), size, &model_);
    }
    const bs_model *get() const { return model_; }

  private:
    std::unique_ptr<Memory> memory_;
    const bs_model *model_ = nullptr;
};

// What is tracked of one point in a frame.
struct Tracked {
    std::int32_t point = 0;
    bool has_position = false, has_rotation = false;
    double position[3] = {}, rotation[4] = {1, 0, 0, 0};  // m, world; wxyz, world <- joint
    double accuracy = 0.001;                              // m, expected error of the position
};

// One completed body.
class Body {
  public:
    double root[3] = {};                // m, world
    double rotation[BS_JOINTS][4] = {}; // wxyz, parent <- joint; the root's is world <- root
    double points[BS_POINTS][3] = {};   // m, world
    double confidence[BS_POINTS] = {};  // m, expected error

    // Begin with a person of known height (m), or of an unknown one (NaN).
    bs_result start(const Model &model, double height = NAN) {
        bs_person person{};
        person.height = height;
        person.height_deviation = 0.025;
        const bs_result likeliest = bs_person_likeliest(model.get(), &person);
        if (likeliest != BS_OK) return likeliest;
        model_ = model.get();
        memory_ = std::make_unique<Memory>(bs_state_size(model_));
        scratch_ = std::make_unique<Memory>(bs_scratch_size(model_, 1));
        return bs_state_start(model_, &person, memory_->at(), memory_->size(), &state_);
    }

    // Complete the next frame, at a time in seconds that increases. After a refusal the body is unchanged.
    bs_result step(double time, const std::vector<Tracked> &tracked) {
        const std::size_t count = tracked.size();
        std::vector<std::int32_t> point(count);
        std::vector<double> position(3 * count), turned(4 * count), accuracy(count);
        std::vector<std::uint8_t> has_position(count), has_rotation(count);
        for (std::size_t p = 0; p < count; ++p) {
            point[p] = tracked[p].point;
            accuracy[p] = tracked[p].accuracy;
            has_position[p] = tracked[p].has_position;
            has_rotation[p] = tracked[p].has_rotation;
            std::memcpy(&position[3 * p], tracked[p].position, sizeof tracked[p].position);
            std::memcpy(&turned[4 * p], tracked[p].rotation, sizeof tracked[p].rotation);
        }
        bs_observation observation{};
        observation.frames = 1;
        observation.points = static_cast<std::int32_t>(count);
        observation.point = point.data();
        observation.time = &time;
        observation.position = position.data();
        observation.rotation = turned.data();
        observation.has_position = has_position.data();
        observation.has_rotation = has_rotation.data();
        observation.accuracy = accuracy.data();
        bs_estimate estimate{};
        estimate.root_position = root;
        estimate.rotation = rotation[0];
        estimate.points = points[0];
        estimate.confidence = confidence;
        const bs_settings settings = bs_default_settings();
        int refused = 0;
        return bs_step(model_, &settings, 1, &observation, &state_, &estimate, scratch_->at(), scratch_->size(),
                       &refused);
    }

  private:
    const bs_model *model_ = nullptr;
    bs_state *state_ = nullptr;
    std::unique_ptr<Memory> memory_, scratch_;
};

}  // namespace bodysense
