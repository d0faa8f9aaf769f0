// Draws every picture when it comes near the window: dozens at once would hold the page up.
const draw = (element) => {
    const { data, layout } = JSON.parse(document.getElementById(element.id.replace("plot", "spec")).textContent);
    Plotly.newPlot(element, data, { ...layout, autosize: true }, { responsive: true, displaylogo: false });
};
const near = new IntersectionObserver((seen) => {
    for (const { isIntersecting, target } of seen) if (isIntersecting) { near.unobserve(target); draw(target); }
}, { rootMargin: "1200px" });
for (const element of document.querySelectorAll(".plot")) near.observe(element);
