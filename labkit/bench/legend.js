// The legend of a picture. It takes plotly as long as two or three axes, and a moved slider hardly ever changes it: plotly draws it
// when it is another one, and what it has drawn is kept beside the picture, which is drawn without.

// A trace that is only an entry of the legend.
const isKey = ({ x }) => x?.length === 1 && x[0] === null;

const ENTRY = ["type", "mode", "name", "visible", "opacity", "marker", "line", "fill", "fillcolor", "showlegend"];  // what an entry is drawn from
const first = (_, value) => (isArray(value) ? value[0] : value);

// The legend of `figure`; `redraw` is called when a reader has clicked on an entry, which hides what has its name or shows it again.
const legendOf = (figure, redraw) => {
    const hidden = new Set();
    let drawn = "", wanted = "", margin = {};

    // What plotly has to draw, and whether that is without a legend, as the one that is there still holds.
    const prepare = (data, layout) => {
        data = data.map((trace) => (hidden.has(trace.name) ? { ...trace, visible: "legendonly" } : trace));
        wanted = layout.showlegend === false ? "" : JSON.stringify([layout.width, layout.height, layout.legend, layout.margin, layout.font])
            + data.filter((trace) => trace.showlegend !== false)
                .map((trace) => JSON.stringify(Object.fromEntries(ENTRY.map((name) => [name, trace[name]])), first) + !trace.x?.length);
        const same = wanted === drawn;
        return { data, layout: same ? { ...layout, showlegend: false, margin: { ...layout.margin, ...margin } } : layout, same };
    };
    // After plotly has drawn: takes the legend over, and the room that was made for it.
    const keep = () => {
        if (wanted === drawn) return;
        drawn = wanted;
        figure.querySelector(".lab-legend")?.remove();
        const { t, r } = figure._fullLayout._size, legend = figure.querySelector(".infolayer > .legend");
        margin = legend ? { t, r } : {};
        if (!legend) return;
        const copy = legend.cloneNode(true), names = [...legend.querySelectorAll(".traces")].map((entry) => entry.__data__[0].trace.name);
        legend.parentNode.after(copy);
        legend.remove();
        copy.setAttribute("class", "lab-legend");
        copy.querySelector(".scrollbox").removeAttribute("clip-path");  // plotly takes what it names away with its legend
        copy.querySelectorAll(".legendtoggle").forEach((entry, i) => {
            if (!figure.data.some((trace) => trace.name === names[i] && !isKey(trace))) return entry.remove();
            entry.addEventListener("click", () => {
                if (!hidden.delete(names[i])) hidden.add(names[i]);
                redraw();
            });
        });
        Object.assign(figure.layout, { showlegend: false, margin: { ...figure.layout.margin, ...margin } });  // should plotly draw by itself
    };
    // What is seen as one figure, for a file.
    const whole = ({ data, layout }) => ({
        data: [...figure.data.filter((trace) => !isKey(trace)), ...data.filter(isKey)],
        layout: { ...figure.layout, showlegend: layout.showlegend, margin: layout.margin },
    });
    return { prepare, keep, whole };
};
