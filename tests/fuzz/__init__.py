"""Random scenes, paths and files: what must hold for every one of them."""
