const video = document.querySelector("video");
for (const button of document.querySelectorAll("button[data-start]")) {
  button.addEventListener("click", () => {
    video.currentTime = Number(button.dataset.start);
    video.scrollIntoView({ block: "center" });
    video.play();
  });
}
