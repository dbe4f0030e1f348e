// Moves a head and two hands as a waving person does, so that an avatar can be seen to move without a headset.
using BodySense;
using UnityEngine;

[RequireComponent(typeof(BodySenseAvatar))]
public sealed class HeadAndHands : MonoBehaviour
{
    BodySenseAvatar avatar;

    void Awake()
    {
        avatar = GetComponent<BodySenseAvatar>();
        avatar.head = Tracker("Head");
        avatar.leftWrist = Tracker("Left wrist");
        avatar.rightWrist = Tracker("Right wrist");
    }

    Transform Tracker(string name)
    {
        var tracker = new GameObject(name).transform;
        tracker.SetParent(transform, false);
        return tracker;
    }

    void Update()
    {
        float swing = Mathf.Sin(5 * Time.time);
        Move(avatar.head, new Vector3(0.02f * swing, 1.55f, 0), Quaternion.identity);
        Move(avatar.leftWrist, new Vector3(-0.25f, 0.85f, 0.05f), Quaternion.Euler(0, 0, 80));
        Move(avatar.rightWrist, new Vector3(0.4f + 0.1f * swing, 1.45f, 0.2f), Quaternion.Euler(0, 0, 80 - 15 * swing));
    }

    static void Move(Transform tracker, Vector3 position, Quaternion rotation)
    {
        tracker.localPosition = position;
        tracker.localRotation = rotation;
    }
}
