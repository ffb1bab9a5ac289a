"""Plugins about other pods: spreading and pod affinity."""
