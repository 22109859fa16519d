// Sections of the menu fold; the section of this page is open, on the first page all are closed but the first.
addEventListener("DOMContentLoaded", () => {
  const captions = document.querySelectorAll(".sidebar-tree > p.caption");
  const current = [...captions].some(caption => caption.nextElementSibling?.classList.contains("current"));
  captions.forEach((caption, index) => {
    const list = caption.nextElementSibling;
    const section = document.createElement("details");
    const summary = document.createElement("summary");
    summary.className = caption.className;
    summary.append(...caption.childNodes);
    section.open = current ? list.classList.contains("current") : index === 0;
    caption.replaceWith(section);
    section.append(summary, list);
  });
});
