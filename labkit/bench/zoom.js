// The mouse on a picture whose time axis the kernel draws anew for every window: each gesture is drawn once, when its answer is
// there. On its own plotly would first draw the old picture in the new window, which takes as long again.

// Plotly draws what the mouse did by a method that can be registered. One of ours looks at it first; a figure may keep it.
const answerable = (lib) => lib.register({
    moduleType: "apiMethod",
    name: "_guiRelayout",
    fn: (figure, ...change) => {
        if (figure.labKeeps?.(change[0])) return Promise.resolve(figure);
        figure._fullLayout._guiEditing = true;  // as plotly's own does it, so that what a reader has hidden stays hidden
        try { return lib.relayout(figure, ...change); } finally { figure._fullLayout._guiEditing = false; }
    },
});

// Gestures on `figure`, once it is drawn, as wishes for a window of its x axis: `wish([low, high])`, or null for all of it.
// `view()` is what is wished or shown now, null where the kernel does not answer. Returns what to call before the next drawing.
const gestures = (figure, view, wish) => {
    let moved = [], rest = [], all = false;
    const places = () => [...figure.querySelectorAll(".overplot > g, .plotclip rect")]
        .map((node) => [node, node.getAttribute("transform") ?? ""]);
    const put = (nodes) => nodes.forEach(([node, place]) => node.setAttribute("transform", place));
    const busy = (yes) => { figure.querySelector(".draglayer").style.pointerEvents = yes ? "none" : ""; };

    figure.on("plotly_relayouting", () => { moved = places(); });
    figure.on("plotly_doubleclick", () => { all = true; });
    figure.labKeeps = (change) => {
        const range = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
        const whole = all || change["xaxis.autorange"];
        all = false;
        if (!view() || !whole && range.some((end) => !Number.isFinite(end))) return false;
        if (!Object.keys(change).every((key) => key.startsWith("xaxis."))) return false;
        rest = places();
        put(moved);  // a picture that was dragged stays where the mouse left it, as its axis does
        moved = [];
        busy(true);
        wish(whole ? null : range);
        return true;
    };
    // The wheel alone scrolls the page.
    figure.addEventListener("wheel", (event) => {
        const now = event.ctrlKey && view();
        if (!now) return;
        event.preventDefault();
        const { left, width } = figure.querySelector(".nsewdrag").getBoundingClientRect();
        const at = now[0] + (now[1] - now[0]) * Math.min(1, Math.max(0, (event.clientX - left) / width));
        const scale = Math.exp(Math.min(100, Math.max(-100, event.deltaY)) / 300);
        wish(now.map((end) => at + (end - at) * scale));
    }, { passive: false });
    return () => {
        put(rest);
        rest = [];
        busy(false);
    };
};
