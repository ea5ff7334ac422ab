// Brings the chosen artifact into view: a long lineage is wider than the window.
const area = document.querySelector("#graph");
const chosen = area.querySelector(".node.chosen");
if (chosen) {
  const [box, frame] = [chosen.getBoundingClientRect(), area.getBoundingClientRect()];
  area.scrollLeft += box.left + box.width / 2 - frame.left - frame.width / 2;
}
// A preview that cannot be drawn leaves no broken image behind.
for (const image of area.querySelectorAll("image")) image.addEventListener("error", () => image.remove());
