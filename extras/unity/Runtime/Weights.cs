// The network's weights: in the package in the editor, and in StreamingAssets of a build.
using System.IO;
using UnityEngine;

namespace BodySense
{
    public static class Weights
    {
        public const string Package = "Packages/org.bodysense.body/StreamingAssets~/completion.safetensors";
        public const string Streamed = "bodysense/completion.safetensors"; // in StreamingAssets

        public static byte[] Load()
        {
            var path = Application.isEditor ? Path.GetFullPath(Package) : Path.Combine(Application.streamingAssetsPath, Streamed);
            return File.ReadAllBytes(path);
        }
    }
}
