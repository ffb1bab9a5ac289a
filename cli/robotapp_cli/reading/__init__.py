"""What commands read: files, and the cluster through kubectl and the scheduler's port."""
