// Mouse, touch and keyboard on a map: pan, zoom, and pointing at a place.

const STEP = 60; // pixels that an arrow key pans
const TAP = 6; // pixels that a finger may slip and still tap

/** `point(x, y, kind)` is told where somebody points ("hover", "tap", "key"); `point(null)` that nobody does. */
export function listen(surface, view, point) {
  const fingers = new Map();
  let start = null;

  const at = (event) => {
    const box = surface.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  };
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, size: Math.hypot(a.x - b.x, a.y - b.y) };
  };

  surface.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    surface.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, at(event));
    start = fingers.size === 1 ? at(event) : null;
    surface.classList.add("grabbed");
  });
  surface.addEventListener("pointermove", (event) => {
    const now = at(event);
    const before = fingers.get(event.pointerId);
    if (!before) {
      if (event.pointerType === "mouse") point(now.x, now.y, "hover");
      return;
    }
    if (fingers.size === 2) {
      const old = spread();
      fingers.set(event.pointerId, now);
      const fresh = spread();
      view.pan(fresh.x - old.x, fresh.y - old.y);
      if (old.size > 0) view.zoom(fresh.size / old.size, fresh.x, fresh.y);
      return;
    }
    if (start && Math.hypot(now.x - start.x, now.y - start.y) < TAP) return;
    start = null;
    fingers.set(event.pointerId, now);
    view.pan(now.x - before.x, now.y - before.y);
  });
  const lifted = (event) => {
    if (!fingers.delete(event.pointerId)) return;
    if (event.type === "pointerup" && start) point(start.x, start.y, "tap");
    start = null;
    if (!fingers.size) surface.classList.remove("grabbed");
  };
  surface.addEventListener("pointerup", lifted);
  surface.addEventListener("pointercancel", lifted);
  surface.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse" && !fingers.size) point(null);
  });
  surface.addEventListener("wheel", (event) => {
    event.preventDefault();
    const { x, y } = at(event);
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    view.zoom(Math.exp(-Math.max(-300, Math.min(300, event.deltaY * lines)) / 400), x, y);
  }, { passive: false });
  surface.addEventListener("dblclick", (event) => view.zoom(2, at(event).x, at(event).y));

  surface.addEventListener("keydown", (event) => {
    const moves = {
      ArrowLeft: () => view.pan(STEP, 0), ArrowRight: () => view.pan(-STEP, 0),
      ArrowUp: () => view.pan(0, STEP), ArrowDown: () => view.pan(0, -STEP),
      "+": () => view.zoom(1.5), "=": () => view.zoom(1.5), "-": () => view.zoom(1 / 1.5),
      "0": () => view.whole(), Home: () => view.whole(),
      Escape: () => point(null),
    };
    const move = event.ctrlKey || event.metaKey || event.altKey ? undefined : moves[event.key];
    if (!move) return;
    event.preventDefault();
    move();
    if (event.key !== "Escape") point(view.centreX, view.centreY, "key");
  });
}
