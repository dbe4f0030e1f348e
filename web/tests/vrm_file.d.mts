export function vrmBytes(boneOf: (joint: string) => string | null, version?: "0" | "1"): Buffer;
