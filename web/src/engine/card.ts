/** The card of a network's file: the metadata that an .onnx carries, read from its own bytes. */

export type Card = Readonly<Record<string, unknown>>;

const METADATA = 14; // field of ONNX' ModelProto
const FORMAT = "bodysense-completion-1";

/** Throws an Error of one line where the bytes are no completion network. */
export function completionCard(bytes: Uint8Array): Card {
  const texts: Record<string, string> = {};
  try {
    for (const [field, value] of fields(bytes)) {
      if (field !== METADATA || !value) continue;
      const pair = new Map([...fields(value)].map(([key, text]) => [key, new TextDecoder().decode(text ?? undefined)]));
      texts[pair.get(1) ?? ""] = pair.get(2) ?? "";
    }
  } catch {
    throw new Error("completion.onnx is damaged; load the page again.");
  }
  const { format, ...rest } = texts;
  if (format !== FORMAT)
    throw new Error(`completion.onnx has the format ${format ?? "of nothing known"}; this page runs ${FORMAT}.`);
  return Object.fromEntries(Object.entries(rest).map(([key, text]) => [key, parsed(text)]));
}

function parsed(text: string): unknown {
  try {
    return JSON.parse(text) as unknown;
  } catch {
    return text;
  }
}

/** Fields of a protobuf message: their numbers, and the bytes of those that have a length. */
function* fields(bytes: Uint8Array): Generator<readonly [number, Uint8Array | null]> {
  let at = 0;
  const varint = (): number => {
    let [value, factor] = [0, 1];
    for (;;) {
      if (at >= bytes.length) throw new RangeError("cut short");
      const byte = bytes[at++];
      value += (byte & 127) * factor;
      if (byte < 128) return value;
      factor *= 128;
    }
  };
  while (at < bytes.length) {
    const key = varint();
    const [field, wire] = [Math.floor(key / 8), key % 8];
    if (wire === 2) {
      const length = varint();
      if (at + length > bytes.length) throw new RangeError("cut short");
      yield [field, bytes.subarray(at, at + length)];
      at += length;
    } else {
      if (wire === 0) varint();
      else if (wire === 1 || wire === 5) at += wire === 1 ? 8 : 4;
      else throw new RangeError(`wire type ${wire}`);
      yield [field, null];
    }
  }
}
