// bodysense.h for C#: every struct, enum and function, in the header's order.
using System;
using System.Runtime.InteropServices;

namespace BodySense
{
    public enum BsResult
    {
        BS_OK = 0,
        BS_MODEL_DAMAGED,
        BS_MODEL_FOREIGN,
        BS_MODEL_NEWER,
        BS_MODEL_INCOMPLETE,
        BS_MEMORY_SMALL,
        BS_STATE_FOREIGN,
        BS_TIME_DISORDERED,
        BS_VALUE_NOT_FINITE,
        BS_POINT_UNKNOWN,
        BS_PERSON_IMPOSSIBLE,
        BS_SETTING_IMPOSSIBLE,
        BS_COUNT_IMPOSSIBLE
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsLength
    {
        public int start, end;
        public double value;
        public double deviation;
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsMount
    {
        public byte worn;
        public byte rotation_only;
        public fixed double translation[3];
        public fixed double rotation[4];
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsPerson
    {
        public fixed double rest_offset[65 * 3];
        public fixed double deviation[65];
        public double height;
        public double height_deviation;
        public int lengths;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 32)] public BsLength[] length;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 52)] public BsMount[] mount;
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsSettings
    {
        public double floor;
        public double ease;
        public double longest_gap;
        public double first;
        public double longest;
        public int hold_feet;
        public int infer;
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsObservation
    {
        public int frames;
        public int points;
        public int* point;
        public double* time;
        public double* position;
        public double* rotation;
        public byte* has_position;
        public byte* has_rotation;
        public double* accuracy;
        public double* acceleration;
    }

    [StructLayout(LayoutKind.Sequential)]
    public unsafe struct BsEstimate
    {
        public double* root_position;
        public double* rotation;
        public double* points;
        public byte* measured;
        public double* confidence;
        public double* bound;
        public double* contact;
        public double* rest_offset;
    }

    public static unsafe class Native
    {
        const string Library = "bodysense"; // bodysense.dll, libbodysense.so, libbodysense.dylib
        public const int Version = 1;       // BS_VERSION of the header that this file mirrors

        [DllImport(Library)] public static extern IntPtr bs_message(BsResult result);
        [DllImport(Library)] public static extern int bs_version();
        [DllImport(Library)] public static extern IntPtr bs_point_name(int point);
        [DllImport(Library)] public static extern UIntPtr bs_model_size(void* file, UIntPtr bytes);
        [DllImport(Library)] public static extern BsResult bs_model_open(void* file, UIntPtr bytes, void* memory, UIntPtr size, void** model);
        [DllImport(Library)] public static extern IntPtr bs_model_kernel(void* model);
        [DllImport(Library)] public static extern BsResult bs_person_likeliest(void* model, ref BsPerson person);
        [DllImport(Library)] public static extern UIntPtr bs_state_size(void* model);
        [DllImport(Library)] public static extern BsResult bs_state_start(void* model, ref BsPerson person, void* memory, UIntPtr size, void** state);
        [DllImport(Library)] public static extern BsResult bs_state_open(void* model, void* memory, UIntPtr size, void** state);
        [DllImport(Library)] public static extern double bs_state_time(void* state);
        [DllImport(Library)] public static extern void bs_state_person(void* state, ref BsPerson person);
        [DllImport(Library)] public static extern int bs_state_contradicts_height(void* state);
        [DllImport(Library)] public static extern BsResult bs_state_update_person(void* model, void* state, ref BsPerson person);
        [DllImport(Library)] public static extern BsSettings bs_default_settings();
        [DllImport(Library)] public static extern UIntPtr bs_scratch_size(void* model, int people);
        [DllImport(Library)] public static extern BsResult bs_step(void* model, BsSettings* settings, int people, BsObservation* observation, void** state, BsEstimate* estimate, void* scratch, UIntPtr scratch_size, int* refused);
    }
}
