import { describe, expect, it } from "vitest";
import { bridgeAddress } from "../../src/server/bridge";

const [plain, safe] = [{ protocol: "http:" }, { protocol: "https:" }];

describe("the address of a bridge", () => {
  it.each([
    ["ws://127.0.0.1:8765/?token=abc", plain, "ws://127.0.0.1:8765/ws?token=abc"],
    [" localhost:8765/?token=abc ", safe, "ws://localhost:8765/ws?token=abc"],
    ["https://192.168.0.7:8765/?token=abc", safe, "wss://192.168.0.7:8765/ws?token=abc"],
    ["wss://bridge.example/at/?token=a", safe, "wss://bridge.example/at/ws?token=a"],
    ["http://192.168.0.7:8765/", plain, "ws://192.168.0.7:8765/ws"],
  ])("is read from %s", (typed, page, address) => expect(bridgeAddress(typed, page)).toBe(address));

  it.each(["", "  ", "a bridge", "ftp://127.0.0.1/", "ws://", "ws://:8765", "javascript:alert(1)"])(
    "is not “%s”",
    (typed) => expect(() => bridgeAddress(typed, plain)).toThrow(/^“[^\n]*” is no address of a bridge: [^\n]*$/),
  );

  it("cannot be on another machine without encryption where the page is encrypted", () => {
    expect(() => bridgeAddress("ws://192.168.0.7:8765", safe)).toThrow(/wss/);
  });
});
