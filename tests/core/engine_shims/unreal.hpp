// The part of Unreal Engine 5 that the listing uses, as declarations, so that it can be type-checked without it.
#pragma once
#include <cstddef>
#include <cstdint>

using uint8 = std::uint8_t;
using int32 = std::int32_t;
using TCHAR = char16_t;
struct FString {
    const TCHAR *operator*() const;
};
struct FVector {
    double X, Y, Z;
    FVector(double, double, double);
    FVector operator/(double) const;
};
FVector operator*(double, const FVector &);
struct FQuat {
    double X, Y, Z, W;
    FQuat(double, double, double, double);
    FQuat operator*(const FQuat &) const;
    static const FQuat Identity;
};
struct FTransform {
    FTransform(const FQuat &, const FVector &);
    FVector GetLocation() const;
    FQuat GetRotation() const;
    static const FTransform Identity;
};
template <typename Value> struct TArray {
    const Value *GetData() const;
    int32 Num() const;
};
template <typename Key_, typename Value_> struct TMap {
    struct Pair {
        Key_ Key;
        Value_ Value;
    };
    const Pair *begin() const;
    const Pair *end() const;
};
struct FFileHelper {
    static bool LoadFileToArray(TArray<uint8> &, const TCHAR *);
};
struct UActorComponent {};
void Log(const TCHAR *, ...);
const TCHAR *FromUtf8(const char *);
const char *ToUtf8(const TCHAR *);

#define TEXT(text) u##text
#define UE_LOG(category, severity, ...) Log(__VA_ARGS__)
#define UTF8_TO_TCHAR(text) FromUtf8(text)
#define TCHAR_TO_UTF8(text) ToUtf8(text)
#define UCLASS(...)
#define UFUNCTION(...)
#define GENERATED_BODY()
