// A component that completes a body, for Unreal Engine 5. Pose an avatar from it, or read WorldOf in a Live Link source.
#pragma once

#include "Components/ActorComponent.h"
#include "CoreMinimal.h"

#include "bodysense.hpp"

#include "BodysenseComponent.generated.h"

UCLASS(ClassGroup = (Animation), meta = (BlueprintSpawnableComponent))
class UBodysenseComponent : public UActorComponent {
    GENERATED_BODY()

  public:
    // File is completion.safetensors; HeightInMetres 0: the height is inferred.
    UFUNCTION(BlueprintCallable)
    bool Start(const FString &File, double HeightInMetres);

    // Tracked has the places of joints by name, such as "head", "left_wrist", relative to the actor.
    UFUNCTION(BlueprintCallable)
    bool Step(double Seconds, const TMap<FString, FTransform> &Tracked);

    // Where a joint is, and how it is turned from its T-pose, relative to the actor.
    UFUNCTION(BlueprintCallable)
    FTransform WorldOf(const FString &Joint) const;

  private:
    bodysense::Model Model;
    bodysense::Body Body;
};
