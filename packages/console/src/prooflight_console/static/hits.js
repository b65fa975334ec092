// From hit to hit of a search: its page keeps in this tab which sheets it lists, and the page of a sheet leads to the next.
"use strict";

const hits = document.getElementById("hits");
if (hits) {
  const kept = JSON.parse(sessionStorage.getItem("hits") ?? '{"sheets": []}');
  const at = kept.sheets.indexOf(location.pathname);
  hits.hidden = at < 0;
  if (at >= 0) {
    hits.querySelector(".back").href = kept.search;
    hits.querySelector("span").textContent = hits.dataset.of.replace("{n}", at + 1).replace("{all}", kept.sheets.length);
    for (const [rel, sheet] of [["prev", kept.sheets[at - 1]], ["next", kept.sheets[at + 1]]]) {
      const link = hits.querySelector(`[data-hit="${rel}"]`);
      if (sheet) Object.assign(link, { href: sheet, rel }); // the arrow keys follow `rel`
      else link.classList.add("none");
    }
  }
} else {
  const keep = () => {
    const sheets = [...document.querySelectorAll(".found .main-cell a")].map((link) => link.pathname);
    sessionStorage.setItem("hits", JSON.stringify({ search: location.pathname + location.search, sheets }));
  };
  keep();
  document.addEventListener("htmx:afterSettle", keep); // more rows
}
