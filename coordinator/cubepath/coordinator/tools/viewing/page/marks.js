// What is special about some steps: labels below the slider, on its axis, and lines in the schedule.
(function (cubepath) {
  "use strict";

  const GAP = 8; // pixels between two labels

  /** The marks of the paths that are shown, by step: {path, step, words}; equal ones stand once. */
  cubepath.marksOf = function (paths) {
    const found = new Map();
    for (const path of new Set(paths)) {
      for (const [step, words] of path.data.marks ?? []) {
        const text = `${path.label(step)}: ${words}`;
        if (!found.has(text)) found.set(text, { path, step, text });
      }
    }
    return [...found.values()].sort((one, other) => one.step - other.step);
  };

  /** Write the labels, each where its step begins, in as few rows as have room for them. */
  cubepath.writeMarks = function (box, view) {
    const marks = cubepath.marksOf(view.stages.map((stage) => stage.path));
    box.hidden = !marks.length;
    box.replaceChildren();
    const wide = box.clientWidth, ends = [];
    for (const { step, text } of marks) {
      const label = cubepath.element("button", { type: "button", title: "Go there" }, text);
      label.addEventListener("click", () => cubepath.seek(step));
      box.append(label);
      const x = (wide * Math.max(0, step - 1)) / view.clock.steps, own = label.offsetWidth;
      const left = x + own <= wide;
      const from = left ? x : Math.max(0, x - own);
      label.classList.toggle("before", !left);
      let row = ends.findIndex((end) => end + GAP <= from);
      if (row < 0) row = ends.length;
      ends[row] = from + own;
      label.style.left = `${from}px`;
      label.style.top = `${row * label.offsetHeight}px`;
      box.style.height = `${ends.length * label.offsetHeight}px`;
    }
  };
})((globalThis.cubepath ??= {}));
