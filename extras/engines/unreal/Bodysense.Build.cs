// The module of the plug-in: the header and the library of `make -C core install PREFIX=…/ThirdParty/bodysense`.
using System.IO;
using UnrealBuildTool;

public class Bodysense : ModuleRules
{
    public Bodysense(ReadOnlyTargetRules Target) : base(Target)
    {
        PCHUsage = PCHUsageMode.UseExplicitOrSharedPCHs;
        PublicDependencyModuleNames.AddRange(new[] { "Core", "CoreUObject", "Engine" });
        string Core = Path.Combine(ModuleDirectory, "ThirdParty", "bodysense");
        PublicIncludePaths.Add(Path.Combine(Core, "include"));
        bool Windows = Target.Platform == UnrealTargetPlatform.Win64;
        string Name = Windows ? "bodysense.dll" : Target.Platform == UnrealTargetPlatform.Mac ? "libbodysense.dylib" : "libbodysense.so";
        string Library = Path.Combine(Core, "lib", Name);
        PublicAdditionalLibraries.Add(Windows ? Path.ChangeExtension(Library, ".lib") : Library);
        RuntimeDependencies.Add("$(BinaryOutputDir)/" + Name, Library);
    }
}
