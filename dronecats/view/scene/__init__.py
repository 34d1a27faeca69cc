"""The 3-D scene and the page server that the editor and the pages of flights share."""
