// Adds the network's weights to the StreamingAssets of every build.
using System.IO;
using UnityEditor.Build;

namespace BodySense
{
    public sealed class WeightsInBuild : BuildPlayerProcessor
    {
        public override void PrepareForBuild(BuildPlayerContext context)
        {
            context.AddAdditionalPathToStreamingAssets(Path.GetFullPath(Weights.Package), Weights.Streamed);
        }
    }
}
