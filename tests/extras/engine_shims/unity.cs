// The part of Unity that the listing uses, as declarations, so that it can be compiled without Unity.
namespace UnityEngine
{
    public enum HumanBodyBones
    {
        Hips, Spine, Chest, UpperChest, Neck, Head, LeftShoulder, RightShoulder, LeftUpperArm, RightUpperArm, LeftLowerArm,
        RightLowerArm, LeftHand, RightHand, LeftUpperLeg, RightUpperLeg, LeftLowerLeg, RightLowerLeg, LeftFoot, RightFoot
    }

    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
    }

    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion identity;
        public static Quaternion Euler(float x, float y, float z) { return identity; }
        public static Quaternion Inverse(Quaternion rotation) { return rotation; }
        public static Quaternion operator *(Quaternion a, Quaternion b) { return a; }
    }

    public class RequireComponent : System.Attribute { public RequireComponent(System.Type type) { } }
    public static class Mathf { public static float Sin(float x) { return x; } }
    public static class Application { public static bool isEditor; public static string streamingAssetsPath; }
    public class GameObject
    {
        public bool activeInHierarchy;
        public Transform transform;
        public GameObject(string name) { }
    }
    public class Component { public T GetComponent<T>() where T : class { return null; } public Transform transform; public GameObject gameObject; }
    public class MonoBehaviour : Component { }
    public class Transform : Component
    {
        public Vector3 position, localPosition;
        public Quaternion rotation, localRotation;
        public void SetParent(Transform parent, bool worldPositionStays) { }
        public Vector3 TransformPoint(Vector3 position) { return position; }
        public Vector3 InverseTransformPoint(Vector3 position) { return position; }
    }
    public class Animator : Component
    {
        public bool enabled;
        public Transform GetBoneTransform(HumanBodyBones bone) { return null; }
    }
    public static class Time { public static double timeAsDouble; public static float time; }
}

namespace UnityEditor.Build
{
    public class BuildPlayerContext
    {
        public void AddAdditionalPathToStreamingAssets(string directoryOrFile, string pathInStreamingAssets) { }
    }
    public abstract class BuildPlayerProcessor
    {
        public abstract void PrepareForBuild(BuildPlayerContext buildPlayerContext);
    }
}
