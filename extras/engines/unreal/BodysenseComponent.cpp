#include "BodysenseComponent.h"

#include "Misc/FileHelper.h"

// bodysense: right-handed, +Y up, facing +Z, metres. Unreal: left-handed, +Z up, facing +X, centimetres.
static FVector ToUnreal(const double *v) { return 100.0 * FVector(v[2], -v[0], v[1]); }
static FQuat ToUnrealTurn(const double *q) { return FQuat(-q[3], q[1], -q[2], q[0]); }

static bool Done(bs_result Result) {
    if (Result != BS_OK) UE_LOG(LogTemp, Error, TEXT("bodysense: %s"), UTF8_TO_TCHAR(bs_message(Result)));
    return Result == BS_OK;
}

bool UBodysenseComponent::Start(const FString &File, double HeightInMetres) {
    TArray<uint8> Weights;
    if (!FFileHelper::LoadFileToArray(Weights, *File)) return Done(BS_MODEL_DAMAGED);
    return Done(Model.open(Weights.GetData(), static_cast<size_t>(Weights.Num()))) &&
           Done(Body.start(Model, HeightInMetres > 0 ? HeightInMetres : NAN));
}

bool UBodysenseComponent::Step(double Seconds, const TMap<FString, FTransform> &Tracked) {
    std::vector<bodysense::Tracked> Points;
    for (const auto &Pair : Tracked) {
        const FVector At = Pair.Value.GetLocation() / 100.0;
        const FQuat Turn = Pair.Value.GetRotation();
        bodysense::Tracked One;
        One.point = bodysense::point_of(TCHAR_TO_UTF8(*Pair.Key));
        if (One.point < 0) return Done(BS_POINT_UNKNOWN);
        One.has_position = One.has_rotation = true;
        One.position[0] = -At.Y, One.position[1] = At.Z, One.position[2] = At.X;
        One.rotation[0] = Turn.W, One.rotation[1] = Turn.Y, One.rotation[2] = -Turn.Z, One.rotation[3] = -Turn.X;
        Points.push_back(One);
    }
    return Done(Body.step(Seconds, Points));
}

FTransform UBodysenseComponent::WorldOf(const FString &Joint) const {
    const int Point = bodysense::point_of(TCHAR_TO_UTF8(*Joint));
    if (Point < 0 || Point >= BS_JOINTS) return FTransform::Identity;
    FQuat Turn = FQuat::Identity;
    for (int J = Point; J >= 0; J = bodysense::PARENTS[J]) Turn = ToUnrealTurn(Body.rotation[J]) * Turn;
    return FTransform(Turn, ToUnreal(Body.points[Point]));
}
