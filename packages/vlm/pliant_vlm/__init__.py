"""The weights of the small vision-language model that comes with pliant: `model.gguf`, and
`mmproj.gguf` with what reads pictures. Nothing here runs them: pliant's extra `local` does."""
