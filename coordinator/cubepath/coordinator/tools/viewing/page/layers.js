// What never changes in a picture: the ground below the modules, and the goal above them.
(function (cubepath) {
  "use strict";

  /**
   * Draw a layer; the context counts in cells, y upwards.
   * @param {CanvasRenderingContext2D} context
   * @param {{ops: object[], outlines: number[][]}} layer
   * @param {number} scale pixels of a cell: outlines of large cells need not be thick
   */
  cubepath.drawLayer = function (context, layer, scale) {
    const shapes = layer.outlines.map(cubepath.outlined);
    for (const op of layer.ops) {
      if (op.op === "fill") fill(context, op, shapes[op.outline], scale);
      else if (op.op === "lines") lines(context, op);
      else cubepath.word(context, op.word, op.at[0], op.at[1], op.size, cubepath.colour(op.face));
    }
  };

  /** A closed path through points x, y, x, y, ... */
  cubepath.outlined = function (points) {
    const path = new Path2D();
    for (let each = 0; each < points.length; each += 2) path.lineTo(points[each], points[each + 1]);
    path.closePath();
    return path;
  };

  /** Write a word that fits in a cell of this size; a letter is as high as on the pictures. */
  cubepath.word = function (context, word, x, y, size, colour) {
    if (!word) return;
    context.save();
    context.translate(x, y);
    context.scale(size / 100, -size / 100);
    context.font = '600 50px system-ui, "Segoe UI", "DejaVu Sans", sans-serif';
    context.textAlign = "center";
    context.textBaseline = "alphabetic";
    context.fillStyle = colour;
    const wide = context.measureText(word).width;
    if (wide > 58) context.scale(58 / wide, 58 / wide);
    context.fillText(word, 0, 18);
    context.restore();
  };

  function fill(context, op, shape, scale) {
    const face = cubepath.colour(op.face), edge = cubepath.colour(op.edge);
    context.save();
    context.globalAlpha = op.alpha;
    // Of a goal that is a long way off something is to be seen.
    context.lineWidth = Math.max(Math.min(op.width, 4 / scale), 0.5 / scale);
    context.lineJoin = "round";
    if (face) context.fillStyle = face;
    if (edge) context.strokeStyle = edge;
    for (let each = 0; each < op.at.length; each += 2) {
      context.save();
      context.translate(op.at[each], op.at[each + 1]);
      if (face) context.fill(shape);
      if (edge && op.width) context.stroke(shape);
      context.restore();
    }
    context.restore();
  }

  function lines(context, op) {
    context.save();
    context.strokeStyle = cubepath.colour(op.edge);
    context.lineWidth = op.width;
    context.lineCap = op.round ? "round" : "butt";
    context.beginPath();
    for (let each = 0; each < op.ends.length; each += 4) {
      context.moveTo(op.ends[each], op.ends[each + 1]);
      context.lineTo(op.ends[each + 2], op.ends[each + 3]);
    }
    context.stroke();
    context.restore();
  }
})((globalThis.cubepath ??= {}));
