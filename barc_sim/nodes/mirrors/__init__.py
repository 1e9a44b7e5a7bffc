"""The node `mirror`: standard messages for RViz, Foxglove and PlotJuggler."""
