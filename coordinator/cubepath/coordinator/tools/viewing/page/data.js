// The document in the page: deflated JSON, and the arrays that stand behind it.
(function (cubepath) {
  "use strict";

  const TYPES = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, i4: Int32Array, f4: Float32Array };

  /**
   * Return the document of a text in base64.
   * @param {string} text
   * @returns {Promise<object>}
   */
  cubepath.unpack = async function (text) {
    const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const whole = await new Response(stream).arrayBuffer();
    const length = new DataView(whole).getUint32(0, true);
    const head = new TextDecoder().decode(new Uint8Array(whole, 8, length));
    return JSON.parse(head, (_, value) => {
      if (value === null || typeof value !== "object" || typeof value.array !== "string") return value;
      return new TYPES[value.array](whole, 8 + length + value.at, value.length);
    });
  };
})((globalThis.cubepath ??= {}));
