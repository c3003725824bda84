// Cells in three dimensions: how they are seen from a side of the robot, and which are in front.
(function (cubepath) {
  "use strict";

  const STEP = Math.PI / 4;
  const INSET = 0.2; // part of a face that is outside its inner outline
  const JOINT = 3; // the kind behind those of edges along each axis
  const TOUCHING = 0.01; // cells that overlap by less only touch

  const dot = (one, other) => one[0] * other[0] + one[1] * other[1] + one[2] * other[2];
  const plus = (one, other, times = 1) => one.map((each, axis) => each + times * other[axis]);
  const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
  const unit = (vector) => vector.map((each) => each / Math.hypot(...vector));

  const LIGHT = unit([-0.4, 0.7, 0.6]); // from the left, from above, from the viewer

  /** A vector turned about an axis of length 1, by Rodrigues' formula. */
  function turned(vector, axis, angle) {
    const cos = Math.cos(angle), sin = Math.sin(angle);
    const aside = cross(axis, vector), along = (1 - cos) * dot(axis, vector);
    return vector.map((each, at) => cos * each + sin * aside[at] + along * axis[at]);
  }

  const spun = (vector, spins) => spins.reduce((found, [axis, angle]) => turned(found, axis, angle), vector);

  /** The directions among some vectors; opposite ones are one. */
  const directions = (vectors) => vectors.filter((vector) => Math.hypot(...vector) > 1e-3).map(unit)
    .reduce((found, each) => (found.some((other) => Math.abs(dot(each, other)) > 0.999) ? found : [...found, each]), []);

  /** The points of a list x, y, z, x, y, z, ... */
  const pointsOf = (flat) => Array.from({ length: flat.length / 3 }, (_, each) => [flat[3 * each], flat[3 * each + 1], flat[3 * each + 2]]);

  /** A convex cell around 0, 0, 0, of which the corners of each face go counter-clockwise. */
  function kindOf(given) {
    const faces = given.map((flat) => {
      const points = pointsOf(flat), sides = points.map((point, each) => plus(point, points.at(each - 1), -1));
      return { points, sides, normal: unit(cross(sides[1], sides[2])) };
    });
    const [normals, sides] = [faces.map(({ normal }) => normal), faces.flatMap((face) => face.sides)].map(directions);
    return { faces, normals, sides, corners: [...new Map(faces.flatMap(({ points }) => points.map((point) => [point.join(), point]))).values()] };
  }

  /** From which side a world is seen; the tilt is fixed, and the view turns about the upward axis. */
  class Camera {
    constructor({ azimuth, tilt, kinds }, steps) {
      const angle = azimuth + steps * STEP;
      const [c, s, level, up] = [Math.cos(angle), Math.sin(angle), Math.cos(tilt), Math.sin(tilt)];
      /** To the right, upwards, and towards the viewer. */
      this.axes = [[c, s, 0], [-s * up, c * up, level], [s * level, -c * level, up]];
      this.kinds = kinds.map(kindOf);
      this.wide = 2 * Math.max(...this.kinds.flatMap(({ corners }) => corners.map((corner) => Math.hypot(...corner))));
      this.still = this.kinds.map((_, kind) => this._faces({ kind, spins: [] }));
    }

    /** A point or a direction as it is seen: to the right, upwards, and towards the viewer. */
    seen(point) {
      return this.axes.map((axis) => dot(axis, point));
    }

    /** A body with its middle at a point. */
    placed(body, point) {
      const [x, y, depth] = this.seen(point);
      return { ...body, x, y, depth, point };
    }

    /** The two ends of a rod, which hold it together with others. */
    jointsOf(body) {
      return [-0.5, 0.5].map((half) => this.placed({ ...body, kind: JOINT, module: undefined },
        plus(body.point, spun([0, 1, 2].map((axis) => (axis === body.kind ? half : 0)), body.spins))));
    }

    /** The faces of a body that are seen, around its middle; `beyond` is the cell before each. */
    _faces({ kind, spins }) {
      const faces = this.kinds[kind].faces.map(({ points, normal }) => {
        const way = this.seen(spun(normal, spins)), corners = points.map((point) => this.seen(spun(point, spins)));
        const middle = corners.reduce((sum, corner) => plus(sum, corner, 1 / corners.length), [0, 0, 0]);
        const [whole, inner] = [0, INSET].map((part) => cubepath.outlined(
          corners.flatMap((corner) => plus(corner, plus(middle, corner, -1), part).slice(0, 2))));
        const beyond = points.reduce((sum, point) => plus(sum, point, 2 / points.length), [0, 0, 0]);
        return { whole, inner, middle, beyond, light: dot(way, LIGHT), facing: way[2] };
      });
      return faces.filter(({ facing }) => facing > 1e-6).sort((one, other) => other.facing - one.facing);
    }

    /** Left, right, low and high of what is around these points. */
    boxOf(points) {
      const far = this.wide / 2 + 0.5, [xs, ys] = [0, 1].map((axis) => points.map((point) => this.seen(point)[axis]));
      return [xs, ys].flatMap((along) => along.reduce(([low, high], at) => [Math.min(low, at - far), Math.max(high, at + far)], [Infinity, -Infinity]));
    }

    /** The bodies of which something is seen, with their faces, in the order in which they are drawn. */
    inOrder(all) {
      const full = new Set(all.filter((body) => body.alpha === 1 && !body.moving).map(({ point }) => point.join()));
      for (const body of all) {
        body.faces = (body.spins.length ? this._faces(body) : this.still[body.kind])
          .filter(({ beyond }) => body.moving || !full.has(plus(body.point, beyond).join()));
      }
      const bodies = all.filter((body) => body.faces.length).sort((one, other) => one.depth - other.depth);
      const found = [], done = new Set(), moving = bodies.filter((body) => body.moving);
      const draw = (body, others) => {
        if (done.has(body)) return;
        done.add(body);
        for (const other of others) if (!done.has(other) && this._isBehind(other, body)) draw(other, bodies);
        found.push(body);
      };
      // Of those that rest, all that are behind this one have their turn before it.
      for (const body of bodies) draw(body, body.moving ? bodies : moving);
      return found;
    }

    /** Whether a body must be drawn before another: the other covers it, beyond a plane between them. */
    _isBehind(one, other) {
      const nearer = one.depth < other.depth, rest = !(one.moving || other.moving);
      if ((rest && !nearer) || (one.x - other.x) ** 2 + (one.y - other.y) ** 2 >= this.wide ** 2) return false;
      const [mine, others] = [one, other].map((body) => body.hull ??= this._hullOf(body));
      const way = plus(other.point, one.point, -1);
      // Beside each other in the picture: an order would only close circles.
      if ([mine, others].some(({ flats }) => flats.some((axis) => side(axis, way, mine, others, 1e-3)))) return false;
      // Cells of a lattice, and the balls around cells that are apart, lie on the two sides of the
      // plane between their middles, to which the line of the middles is normal.
      if (rest || dot(way, way) >= this.wide ** 2) return nearer;
      const between = (axis) => dot(axis, this.axes[2]) * side(axis, way, mine, others, TOUCHING);
      for (const axis of [...mine.normals, ...others.normals]) if (between(axis)) return between(axis) > 0;
      for (const edge of mine.sides) {
        for (const each of others.sides) if (between(cross(edge, each))) return between(cross(edge, each)) > 0;
      }
      return nearer;
    }

    /** What planes can lie along a body, and how far it reaches; those that do not turn share it. */
    _hullOf({ kind, spins }) {
      const found = this.kinds[kind], turn = (vectors) => vectors.map((each) => spun(each, spins));
      if (!spins.length && found.flats) return found;
      const sides = turn(found.sides), flats = sides.map((each) => cross(each, this.axes[2]));
      const shape = { normals: turn(found.normals), sides, flats, corners: turn(found.corners) };
      return spins.length ? shape : Object.assign(found, shape);
    }
  }

  /** On which side of one shape another lies, 1 or -1 along the axis; 0 if no plane across it is between. */
  function side(axis, way, one, other, slack) {
    const along = dot(axis, way), size = Math.sqrt(dot(axis, axis));
    if (size < 1e-3) return 0;
    return Math.abs(along) - reach(one, axis) - reach(other, axis) > -slack * size ? Math.sign(along) : 0;
  }

  /** How far a shape reaches along an axis, which is as far as the other way: cells are symmetric. */
  function reach({ corners }, axis) {
    let most = 0;
    for (const corner of corners) most = Math.max(most, dot(corner, axis));
    return most;
  }

  Object.assign(cubepath, { Camera, plus, pointsOf, turned });
})((globalThis.cubepath ??= {}));
