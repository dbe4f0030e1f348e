// A node that completes a body, as a GDExtension over godot-cpp 4. From GDScript:
//
//     var body := BodysenseBody.new()
//     body.start(FileAccess.get_file_as_bytes("res://completion.safetensors"), 1.75)   # m; 0: the height is inferred
//     body.step(seconds, {"head": $XRCamera3D.transform, "left_wrist": $LeftHand.transform})
//     skeleton.set_bone_pose_rotation(bone, body.rotation_of("left_elbow"))
//
// Godot's axes are those of bodysense: right-handed, +Y up, metres. A skeleton faces +Z.
#include <godot_cpp/classes/node.hpp>
#include <godot_cpp/core/class_db.hpp>
#include <godot_cpp/godot.hpp>
#include <godot_cpp/variant/dictionary.hpp>
#include <godot_cpp/variant/packed_byte_array.hpp>
#include <godot_cpp/variant/quaternion.hpp>
#include <godot_cpp/variant/string.hpp>
#include <godot_cpp/variant/transform3d.hpp>
#include <godot_cpp/variant/vector3.hpp>

#include "bodysense.hpp"

using namespace godot;

class BodysenseBody : public Node {
    GDCLASS(BodysenseBody, Node)

  public:
    bool start(const PackedByteArray &weights, double height) {
        return done(model_.open(weights.ptr(), static_cast<size_t>(weights.size()))) &&
               done(body_.start(model_, height > 0 ? height : NAN));
    }

    bool step(double time, const Dictionary &tracked) {
        std::vector<bodysense::Tracked> points;
        const Array names = tracked.keys();
        for (int64_t k = 0; k < names.size(); ++k) {
            const String name = names[k];
            const Transform3D place = tracked[name];
            const Quaternion turn = place.basis.get_rotation_quaternion();
            bodysense::Tracked one;
            one.point = bodysense::point_of(name.utf8().get_data());
            if (one.point < 0) return done(BS_POINT_UNKNOWN);
            one.has_position = one.has_rotation = true;
            one.position[0] = place.origin.x, one.position[1] = place.origin.y, one.position[2] = place.origin.z;
            one.rotation[0] = turn.w, one.rotation[1] = turn.x, one.rotation[2] = turn.y, one.rotation[3] = turn.z;
            points.push_back(one);
        }
        return done(body_.step(time, points));
    }

    Vector3 root_position() const { return vector(body_.root); }

    // Rotation of a joint in its parent's axes; identity in the T-pose. The pelvis' is in the world.
    Quaternion rotation_of(const String &joint) const {
        const int j = bodysense::point_of(joint.utf8().get_data());
        if (j < 0 || j >= BS_JOINTS) return Quaternion();
        const double *q = body_.rotation[j];
        return Quaternion(float(q[1]), float(q[2]), float(q[3]), float(q[0]));
    }

    Vector3 point(const String &name) const {
        const int p = bodysense::point_of(name.utf8().get_data());
        return p < 0 ? Vector3() : vector(body_.points[p]);
    }

  protected:
    static void _bind_methods() {
        ClassDB::bind_method(D_METHOD("start", "weights", "height"), &BodysenseBody::start);
        ClassDB::bind_method(D_METHOD("step", "time", "tracked"), &BodysenseBody::step);
        ClassDB::bind_method(D_METHOD("root_position"), &BodysenseBody::root_position);
        ClassDB::bind_method(D_METHOD("rotation_of", "joint"), &BodysenseBody::rotation_of);
        ClassDB::bind_method(D_METHOD("point", "name"), &BodysenseBody::point);
    }

  private:
    bodysense::Model model_;
    bodysense::Body body_;

    static Vector3 vector(const double *v) { return Vector3(float(v[0]), float(v[1]), float(v[2])); }

    static bool done(bs_result result) {
        ERR_FAIL_COND_V_MSG(result != BS_OK, false, bs_message(result));
        return true;
    }
};

static void initialize(ModuleInitializationLevel level) {
    if (level == MODULE_INITIALIZATION_LEVEL_SCENE) GDREGISTER_CLASS(BodysenseBody);
}

static void terminate(ModuleInitializationLevel) {}

extern "C" GDExtensionBool GDE_EXPORT bodysense_init(GDExtensionInterfaceGetProcAddress address,
                                                     GDExtensionClassLibraryPtr library,
                                                     GDExtensionInitialization *initialization) {
    GDExtensionBinding::InitObject init(address, library, initialization);
    init.register_initializer(initialize);
    init.register_terminator(terminate);
    init.set_minimum_library_initialization_level(MODULE_INITIALIZATION_LEVEL_SCENE);
    return init.init();
}
