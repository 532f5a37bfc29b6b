// The choice among versions of the manual that stand beside each other. `make site` lists them with
// their pages in a file above them; a manual that stands alone has none, and shows no choice.
(() => {
  const root = new URL(document.documentElement.dataset.content_root, location);
  const list = document.createElement("script");
  list.src = new URL("../versions.js", root);
  list.onload = () => {
    const here = decodeURIComponent(root.pathname).split("/").at(-2);
    const path = location.href.split(/[?#]/)[0].slice(root.href.length);
    const page = decodeURIComponent(path) || "index.html";
    const choice = document.createElement("select");
    for (const { version } of window.manualVersions) {
      choice.add(new Option(version, version, false, version === here));
    }
    choice.onchange = () => {
      const { version, pages } = window.manualVersions[choice.selectedIndex];
      location.href = new URL(`../${version}/${pages.includes(page) ? page : "index.html"}`, root);
    };
    const label = document.createElement("label");
    label.className = "versions";
    label.append("Version ", choice);
    document.querySelector(".sidebar-brand").after(label);
  };
  document.head.append(list);
})();
