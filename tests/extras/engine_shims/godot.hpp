// The part of godot-cpp 4 that the listing uses, as declarations, so that it can be type-checked without godot-cpp.
#pragma once
#include <cstddef>
#include <cstdint>

using GDExtensionBool = std::uint8_t;
using GDExtensionInterfaceGetProcAddress = void (*(*)(const char *))();
using GDExtensionClassLibraryPtr = void *;
struct GDExtensionInitialization;

namespace godot {

using real_t = float;
class CharString {
  public:
    const char *get_data() const;
};
class String {
  public:
    CharString utf8() const;
};
struct Vector3 {
    real_t x, y, z;
    Vector3();
    Vector3(real_t x, real_t y, real_t z);
};
struct Quaternion {
    real_t x, y, z, w;
    Quaternion();
    Quaternion(real_t x, real_t y, real_t z, real_t w);
};
struct Basis {
    Quaternion get_rotation_quaternion() const;
};
struct Transform3D {
    Basis basis;
    Vector3 origin;
};
class Variant {
  public:
    Variant(const String &);
    operator String() const;
    operator Transform3D() const;
};
class Array {
  public:
    std::int64_t size() const;
    const Variant &operator[](std::int64_t) const;
};
class Dictionary {
  public:
    Array keys() const;
    const Variant &operator[](const Variant &) const;
};
class PackedByteArray {
  public:
    const std::uint8_t *ptr() const;
    std::int64_t size() const;
};
class Node {};
struct MethodDefinition {};
class ClassDB {
  public:
    template <typename Method> static void bind_method(const MethodDefinition &, Method);
    template <typename Class> static void register_class();
};
template <typename... Names> MethodDefinition D_METHOD(const char *, const Names...);
enum ModuleInitializationLevel { MODULE_INITIALIZATION_LEVEL_SCENE = 2 };
struct GDExtensionBinding {
    struct InitObject {
        InitObject(GDExtensionInterfaceGetProcAddress, GDExtensionClassLibraryPtr, GDExtensionInitialization *);
        void register_initializer(void (*)(ModuleInitializationLevel)) const;
        void register_terminator(void (*)(ModuleInitializationLevel)) const;
        void set_minimum_library_initialization_level(ModuleInitializationLevel) const;
        GDExtensionBool init() const;
    };
};
void print_error(const char *);

}  // namespace godot

#define GDE_EXPORT
#define GDCLASS(name, base) \
  public:                   \
    static void bind() { _bind_methods(); }
#define GDREGISTER_CLASS(name) ClassDB::register_class<name>()
#define ERR_FAIL_COND_V_MSG(condition, value, message) \
    if (condition) {                                   \
        print_error(message);                          \
        return value;                                  \
    }
