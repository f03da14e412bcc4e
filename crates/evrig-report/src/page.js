"use strict";
// Comforts; the page is complete without them.

// A table sorts by the head that is pressed; numbers by value, words as people sort them.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const key = (row, i) => {
    const cell = row.cells[i];
    return cell.dataset.key === undefined ? cell.textContent.trim() : Number(cell.dataset.key);
  };
  const compare = (a, b) => {
    if (typeof a === "number" && typeof b === "number") return a - b;
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return a.localeCompare(b, undefined, { numeric: true });
  };
  heads.forEach((head, i) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const rows = [...body.rows].sort((a, b) => compare(key(a, i), key(b, i)));
      body.append(...(down ? rows.reverse() : rows));
    });
  });
}

// The values under the pointer, read from the scales that each plot states.
const reader = (text, isUp) => {
  const [kind, low, high] = text.split(" ").map((part, i) => (i ? Number(part) : part));
  return (share) => {
    if (kind === "pix") return String(Math.min(high - 1, Math.floor(share * high)));
    const s = isUp ? 1 - share : share;
    const v = kind === "log" ? low * (high / low) ** s : low + (high - low) * s;
    return Number(v.toPrecision(3)).toString();
  };
};
for (const pad of document.querySelectorAll(".pad")) {
  const readX = reader(pad.dataset.x, false);
  const readY = reader(pad.dataset.y, true);
  const drawing = pad.closest(".drawing");
  let output = null;
  pad.addEventListener("pointermove", (event) => {
    const box = pad.getBoundingClientRect();
    const share = (v, from, length) => Math.min(1, Math.max(0, (v - from) / length));
    output ??= drawing.appendChild(Object.assign(document.createElement("output"), { className: "read-out" }));
    const x = readX(share(event.clientX, box.left, box.width));
    const y = readY(share(event.clientY, box.top, box.height));
    output.textContent = `x ${x}, y ${y}`;
  });
  pad.addEventListener("pointerleave", () => {
    output?.remove();
    output = null;
  });
}

// A link into a folded section opens it; a printed page is unfolded.
const unfold = (element) => {
  for (let e = element; e; e = e.parentElement) if (e.tagName === "DETAILS") e.open = true;
};
const follow = () => unfold(location.hash && document.getElementById(location.hash.slice(1)));
addEventListener("hashchange", follow);
follow();
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(unfold));
