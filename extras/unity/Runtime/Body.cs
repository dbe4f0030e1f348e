// One completed body, in the axes of bodysense.h.
using System;
using System.Runtime.InteropServices;

namespace BodySense
{
    public sealed unsafe class Body : IDisposable
    {
        public const int Joints = 52, Points = 65;

        // The parent of each joint; parents come before their children.
        public static readonly int[] Parents =
        {
            -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 22, 23, 20,
            25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50
        };

        public readonly double[] Root = new double[3];             // m, world
        public readonly double[] Rotation = new double[4 * Joints]; // wxyz, parent <- joint; the root's is world <- root
        public readonly double[] Confidence = new double[Points];   // m, expected error

        readonly double[] position = new double[3 * Points], turned = new double[4 * Points];
        readonly double[] accuracy = new double[Points];
        readonly byte[] hasPosition = new byte[Points], hasRotation = new byte[Points];
        readonly int[] point = new int[Points];
        readonly IntPtr memory, stateMemory, scratchMemory;
        readonly void* model, state, scratch;
        readonly UIntPtr scratchSize;

        // weights: the content of completion.safetensors (`Weights.Load()`). height: m; NaN: inferred.
        public Body(byte[] weights, double height = double.NaN)
        {
            if (Native.bs_version() != Native.Version)
                throw new InvalidOperationException("bodysense: the library and BodySenseNative.cs differ in version");
            fixed (byte* file = weights)
            {
                var bytes = (UIntPtr)weights.Length;
                var size = Native.bs_model_size(file, bytes);
                if (size == UIntPtr.Zero) Check(BsResult.BS_MODEL_DAMAGED);
                IntPtr first = Marshal.AllocHGlobal(new IntPtr((long)size + 64));
                void* opened;
                var result = Native.bs_model_open(file, bytes, Aligned(first), size, &opened);
                if (result != BsResult.BS_OK) Marshal.FreeHGlobal(first);
                Check(result);
                memory = first;
                model = opened;
            }
            var person = new BsPerson { height = height, height_deviation = 0.025, length = new BsLength[32], mount = new BsMount[52] };
            Check(Native.bs_person_likeliest(model, ref person));
            var stateSize = Native.bs_state_size(model);
            scratchSize = Native.bs_scratch_size(model, 1);
            stateMemory = Marshal.AllocHGlobal(new IntPtr((long)stateSize + 64));
            scratchMemory = Marshal.AllocHGlobal(new IntPtr((long)scratchSize + 64));
            void* started;
            Check(Native.bs_state_start(model, ref person, Aligned(stateMemory), stateSize, &started));
            state = started;
            scratch = Aligned(scratchMemory);
            for (int p = 0; p < Points; p++) point[p] = p;
        }

        public static string NameOf(int point) { return Marshal.PtrToStringAnsi(Native.bs_point_name(point)); }

        public static int PointOf(string name)
        {
            for (int p = 0; p < Points; p++) if (NameOf(p) == name) return p;
            throw new ArgumentException("bodysense: no point is called " + name);
        }

        // Forget what was tracked, before the next frame's points are given.
        public void Clear() { Array.Clear(hasPosition, 0, Points); Array.Clear(hasRotation, 0, Points); }

        public void Track(int p, double x, double y, double z, double error = 0.001)
        {
            hasPosition[p] = 1;
            accuracy[p] = error; // m
            position[3 * p] = x; position[3 * p + 1] = y; position[3 * p + 2] = z;
        }

        public void Turn(int joint, double w, double x, double y, double z)
        {
            hasRotation[joint] = 1;
            turned[4 * joint] = w; turned[4 * joint + 1] = x; turned[4 * joint + 2] = y; turned[4 * joint + 3] = z;
        }

        // Complete the next frame; time is in seconds and increases.
        public void Step(double time)
        {
            fixed (int* points = point)
            fixed (double* places = position, turns = turned, errors = accuracy, root = Root, rotation = Rotation, sure = Confidence)
            fixed (byte* placed = hasPosition, isTurned = hasRotation)
            {
                var seen = new BsObservation { frames = 1, points = Points, point = points, time = &time, position = places,
                    rotation = turns, has_position = placed, has_rotation = isTurned, accuracy = errors };
                var made = new BsEstimate { root_position = root, rotation = rotation, confidence = sure };
                var settings = Native.bs_default_settings();
                void* one = state;
                int refused;
                Check(Native.bs_step(model, &settings, 1, &seen, &one, &made, scratch, scratchSize, &refused));
            }
        }

        public void Dispose()
        {
            Marshal.FreeHGlobal(memory);
            Marshal.FreeHGlobal(stateMemory);
            Marshal.FreeHGlobal(scratchMemory);
        }

        static void* Aligned(IntPtr start) { return (void*)(((long)start + 63) / 64 * 64); }

        static void Check(BsResult result)
        {
            if (result != BsResult.BS_OK)
                throw new InvalidOperationException("bodysense: " + Marshal.PtrToStringAnsi(Native.bs_message(result)));
        }
    }
}
