// Colours by their meaning, light or dark, and canvases as sharp as the screen.
(function (cubepath) {
  "use strict";

  const known = new Map();

  /** Forget the colours: the page has become light, dark or print. */
  cubepath.forgetColours = () => known.clear();

  /** The colour of a role such as "wall", or the colour itself; null for "none". */
  cubepath.colour = function (name) {
    if (name === "none") return null;
    if (name.startsWith("#")) return name;
    if (!known.has(name)) {
      const style = getComputedStyle(document.documentElement);
      known.set(name, style.getPropertyValue(`--${name}`).trim() || name);
    }
    return known.get(name);
  };

  /** The colour in which a word can be read on this one. */
  cubepath.inkOn = function (colour) {
    const [red, green, blue] = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);
    return 0.3 * red + 0.59 * green + 0.11 * blue > 0.5 ? "#22252a" : "#ffffff";
  };

  /** The colour of a face on which so much light falls, from -1 to 1; as in pictures. */
  cubepath.shaded = (colour, light) =>
    `rgb(${[1, 3, 5].map((at) => Math.round((0.7 + 0.3 * light) * parseInt(colour.slice(at, at + 2), 16))).join(" ")})`;

  /** A colour mixed with that of the page, `part` of it. */
  cubepath.faint = function (colour, part) {
    const page = cubepath.colour("page");
    const mix = (at) => Math.round(
      part * parseInt(colour.slice(at, at + 2), 16) + (1 - part) * parseInt(page.slice(at, at + 2), 16));
    return `rgb(${mix(1)} ${mix(3)} ${mix(5)})`;
  };

  /** Give a canvas the pixels of its box; return its context, in CSS pixels, and its size. */
  cubepath.prepared = function (canvas) {
    const ratio = Math.max(1, document.documentElement.dataset.print === undefined ? devicePixelRatio : 3);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    const wide = Math.round(width * ratio), high = Math.round(height * ratio);
    const changed = canvas.width !== wide || canvas.height !== high;
    if (changed) {
      canvas.width = wide;
      canvas.height = high;
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    return { context, width, height, ratio, changed };
  };

  /** A canvas beside the page, of the same size. */
  cubepath.spare = function (like) {
    const canvas = document.createElement("canvas");
    canvas.width = like.width;
    canvas.height = like.height;
    return canvas;
  };
})((globalThis.cubepath ??= {}));
