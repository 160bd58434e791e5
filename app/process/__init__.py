"""Parts of a run in processes of their own: started, fed and shared with, on every system."""
