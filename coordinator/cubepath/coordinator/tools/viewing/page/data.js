// The document in the page: deflated JSON in base64.
(function (cubepath) {
  "use strict";

  /** The document of a text. @param {string} text @returns {Promise<object>} */
  cubepath.unpack = async function (text) {
    const packed = Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).json();
  };

  /** The text of a document, as `pack` in `pages.py` has it. @param {object} data @returns {Promise<string>} */
  cubepath.pack = async function (data) {
    const stream = new Blob([JSON.stringify(data)]).stream().pipeThrough(new CompressionStream("deflate"));
    const packed = new Uint8Array(await new Response(stream).arrayBuffer());
    let text = "";
    for (let each = 0; each < packed.length; each += 0x8000) text += String.fromCharCode(...packed.subarray(each, each + 0x8000));
    return btoa(text);
  };
})((globalThis.cubepath ??= {}));
