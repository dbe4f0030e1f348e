/** Whether a file that was dropped may be a VRM avatar: judged by its size and first bytes, before it is read whole. */

const LARGEST = 200; // MB
const GLB_MAGIC = 0x46546c67; // "glTF", little-endian

/** The bytes of a file that may be a VRM. Throws an Error of one line for what is none. */
export async function avatarBytes(
  file: Pick<Blob, "size" | "slice" | "arrayBuffer"> & { readonly name: string },
): Promise<ArrayBuffer> {
  const megabytes = file.size / 1e6;
  if (megabytes > LARGEST) {
    throw new Error(
      `${file.name} has ${megabytes.toFixed(0)} MB; an avatar may have ${LARGEST} MB: make its textures smaller.`,
    );
  }
  const head = await file.slice(0, 12).arrayBuffer();
  if (head.byteLength < 12 || new DataView(head).getUint32(0, true) !== GLB_MAGIC) {
    throw new Error(
      `${file.name} is no VRM avatar; drop a .vrm file (VRM 0 or 1), as VRoid Studio or Blender's VRM add-on write it.`,
    );
  }
  return file.arrayBuffer();
}
