// Drives a humanoid avatar from a headset and two controllers. The avatar is in its T-pose when the scene starts.
using UnityEngine;

namespace BodySense
{
    public sealed class BodySenseAvatar : MonoBehaviour
    {
        public Transform head, leftWrist, rightWrist; // where the wearer's joints are; children of the headset and controllers
        public float height;                  // m; 0: inferred

        static readonly (string joint, HumanBodyBones human)[] Bones =
        {
            ("pelvis", HumanBodyBones.Hips), ("spine1", HumanBodyBones.Spine), ("spine2", HumanBodyBones.Chest),
            ("spine3", HumanBodyBones.UpperChest), ("neck", HumanBodyBones.Neck), ("head", HumanBodyBones.Head),
            ("left_collar", HumanBodyBones.LeftShoulder), ("right_collar", HumanBodyBones.RightShoulder),
            ("left_shoulder", HumanBodyBones.LeftUpperArm), ("right_shoulder", HumanBodyBones.RightUpperArm),
            ("left_elbow", HumanBodyBones.LeftLowerArm), ("right_elbow", HumanBodyBones.RightLowerArm),
            ("left_wrist", HumanBodyBones.LeftHand), ("right_wrist", HumanBodyBones.RightHand),
            ("left_hip", HumanBodyBones.LeftUpperLeg), ("right_hip", HumanBodyBones.RightUpperLeg),
            ("left_knee", HumanBodyBones.LeftLowerLeg), ("right_knee", HumanBodyBones.RightLowerLeg),
            ("left_ankle", HumanBodyBones.LeftFoot), ("right_ankle", HumanBodyBones.RightFoot)
        };

        Body body;
        readonly Transform[] bone = new Transform[Body.Joints];
        readonly Quaternion[] rest = new Quaternion[Body.Joints], world = new Quaternion[Body.Joints];

        void Start()
        {
            body = new Body(Weights.Load(), height > 0 ? height : double.NaN);
            var animator = GetComponent<Animator>();
            foreach (var pair in Bones)
            {
                int joint = Body.PointOf(pair.joint);
                bone[joint] = animator.GetBoneTransform(pair.human);
                if (bone[joint] != null) rest[joint] = Quaternion.Inverse(transform.rotation) * bone[joint].rotation;
            }
            animator.enabled = false;
        }

        void Update()
        {
            body.Clear();
            Give("head", head);
            Give("left_wrist", leftWrist);
            Give("right_wrist", rightWrist);
            body.Step(Time.timeAsDouble);
            // x is mirrored: Unity is left-handed.
            bone[0].position = transform.TransformPoint(new Vector3((float)-body.Root[0], (float)body.Root[1], (float)body.Root[2]));
            for (int joint = 0; joint < Body.Joints; joint++)
            {
                double[] q = body.Rotation;
                var local = new Quaternion((float)q[4 * joint + 1], (float)-q[4 * joint + 2], (float)-q[4 * joint + 3], (float)q[4 * joint]);
                world[joint] = joint == 0 ? local : world[Body.Parents[joint]] * local;
                if (bone[joint] != null) bone[joint].rotation = transform.rotation * world[joint] * rest[joint];
            }
        }

        void Give(string name, Transform tracker)
        {
            if (tracker == null || !tracker.gameObject.activeInHierarchy) return; // not tracked
            int joint = Body.PointOf(name);
            Vector3 at = transform.InverseTransformPoint(tracker.position);
            Quaternion turn = Quaternion.Inverse(transform.rotation) * tracker.rotation;
            body.Track(joint, -at.x, at.y, at.z);
            body.Turn(joint, turn.w, turn.x, -turn.y, -turn.z);
        }

        void OnDestroy() { if (body != null) body.Dispose(); }
    }
}
